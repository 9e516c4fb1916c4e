"""The Cramér-Rao bound of a tumbling body's rate, and the filter that knows its motion: what no
estimator and what nobody without the body's parameters can be better than.

    J ω̇ = -N S Nᵀ ω - ω × J ω,   y = G Nᵀ ω,   J = I + Σ j_k E_k,   N = N0 - b0 βᵀ

The unknowns are ω(0) 3, j 5, β 2, S 3, G 6. Sensitivities are the imaginary parts of a motion whose
unknowns have an imaginary part of 1e-30 (complex step): no derivative is written down."""

from dataclasses import dataclass

import numpy as np

from bodies import DT, Bodies, euler, moved

STEP = 1e-30
MOVING, GAINS = 13, 6
E = np.array([np.diag([1, -1, 0]), np.diag([1, 1, -2]) / np.sqrt(3)] + [np.zeros((3, 3))] * 3)
E[[2, 3, 4], [0, 0, 1], [1, 2, 2]] = E[[2, 3, 4], [1, 2, 2], [0, 0, 1]] = 1
E /= np.sqrt(2)
"""Orthonormal traceless symmetric matrices (5, 3, 3)."""


def sensitivities(group: Bodies, samples, dt=DT):
    """∂ω/∂ (samples+1, B, 3, 19) and ∂y/∂ by the unknowns, in coordinates about each body's own
    unseen direction; and the gains G (B, 3, 2)."""
    scale = np.trace(group.J, axis1=1, axis2=2)[:, None, None] / 3
    plane = np.linalg.svd(group.b[:, None])[2][:, 1:].swapaxes(1, 2)  # N0: B × 3 × 2
    J, G = group.J / scale, group.C @ plane
    S = -plane.swapaxes(1, 2) @ (group.D / scale) @ plane
    steps = 1j * STEP * np.eye(MOVING)[:, :, None]  # direction × unknown × 1
    B = len(group.w)
    w = group.w[:, None] + steps[:, :3, 0]  # B × 13 × 3
    J = J[:, None] + np.einsum("dk,kij->dij", steps[:, 3:8, 0], E)
    tilt = np.einsum("bi,dk->bdik", group.b, steps[:, 8:10, 0])
    N = plane[:, None] - tilt
    S = S[:, None] + steps[:, [10, 11, 11, 12], 0].reshape(MOVING, 2, 2)
    D = -N @ S @ N.swapaxes(-1, -2)
    f = euler(J.reshape(-1, 3, 3), D.reshape(-1, 3, 3))
    x = moved(f, w.reshape(-1, 3).T, samples, dt).reshape(samples + 1, 3, B, MOVING)
    C = G[:, None] @ N.swapaxes(-1, -2)
    of_x, of_y = np.zeros((2, samples + 1, B, 3, MOVING + GAINS))
    of_x[..., :MOVING] = np.moveaxis(x.imag, 1, 2) / STEP
    of_y[..., :MOVING] = np.einsum("bdij,tjbd->tbid", C, x).imag / STEP
    seen = np.einsum("bjk,tjb->tbk", plane, x[..., 0].real)
    for i in range(3):
        of_y[..., i, MOVING + 2 * i : MOVING + 2 * i + 2] = seen
    return of_x, of_y


def weights(cases):
    """1 / deviation (B, 3) of recorded rates, recorded torques and later ones; and the recordings'
    root-mean-square rate and torque (B). A millionth of them stands in for no noise."""
    rms = np.array([np.sqrt(np.mean(np.sum(case.x**2, axis=1))) for case in cases])
    size = np.array([np.sqrt(np.mean(case.y**2)) for case in cases])
    noise = np.array([case.noise for case in cases])
    return 1 / np.maximum(noise, 1e-6 * np.array([rms, size, size]).T), rms, size


@dataclass(frozen=True)
class Camera:
    """Reads all three rates beside the torque, for some time after the recording."""

    noise: float
    """Deviation, rad/s."""
    until: int
    """Samples after the recording's end."""
    every: int = 10
    """Samples from one reading to the next."""

    def sees(self, k):
        """Whether it reads the rates `k` samples after the recording's end."""
        return (k >= 0) & (k < self.until) & (k % self.every == 0)


def bound(of_x, of_y, cases, recorded, earlier=None, camera=None):
    """Deviations (N, B) in rad/s of |ω̂ - ω| after the recording (T samples) that outputs before it,
    the recording and the prior allow; and sensitivities `earlier` (x, y) of another recording that
    ended before, of which nothing is known but that it is of the same body; and a `camera`.

    R is the triangular factor of all whitened rows so far (square root of the information): a
    recording without noise has a condition of 1e12, which its square would not bear."""
    weight, W, size = weights(cases)
    one = np.ones(len(cases))
    prior = [0 * one] * 3 + [one / 0.35] * 5 + [one] * 2 + [1 / (0.3 * W)] * 3
    prior += [W / (10 * size)] * GAINS
    R = np.transpose(prior)[:, :, None] * np.eye(MOVING + GAINS)
    for x, y in zip(*earlier, strict=True) if earlier else ():
        rows = [R, y * weight[:, 1, None, None], x * weight[:, 0, None, None]]
        R = np.linalg.qr(np.concatenate(rows, 1), mode="r")
    R[:, :3] = 0  # its first rate is not that of the next recording: a flat prior
    return deviations(R, of_x, of_y, weight, recorded, camera)


def deviations(R, of_x, of_y, weight, recorded, camera=None):
    """Deviations (N, B) of the rates after the recording, from the triangular factor R of what is
    known before it; that of an instant is before its own outputs and reading."""
    found = []
    for k, (x, y) in enumerate(zip(of_x, of_y, strict=True)):
        if k > recorded:
            root = np.linalg.solve(R.swapaxes(-1, -2), x.swapaxes(-1, -2))
            found.append(np.sqrt(np.sum(root**2, axis=(1, 2))))
        rows = [R, y * weight[:, 1 + (k >= recorded), None, None]]
        rows += [x * weight[:, 0, None, None]] * (k <= recorded)
        if camera is not None and camera.sees(k - recorded):
            rows.append(x / camera.noise)
        R = np.linalg.qr(np.concatenate(rows, 1), mode="r")
    return np.array(found)


def known(group: Bodies, cases, dt=DT):
    """Estimates (N, B, 3) of the extended Kalman filter that knows each body and begins at the last
    recorded rate."""
    weight = weights(cases)[0]
    x = np.array([case.x[-1] for case in cases])
    P = np.maximum([case.noise[0] for case in cases], 1e-6)[:, None, None] ** 2 * np.eye(3)
    C, R = group.C, np.eye(3) / weight[:, 2, None, None] ** 2
    stack = [np.repeat(M, 3, axis=0) for M in (group.J, group.D)]
    f, Y = euler(*stack), np.stack([case.Y for case in cases], 1)
    found = np.empty(Y.shape)
    for k, y in enumerate(Y):
        PC = P @ C.swapaxes(1, 2)
        K = np.linalg.solve(C @ PC + R, PC.swapaxes(1, 2)).swapaxes(1, 2)
        x = x + np.einsum("bij,bj->bi", K, y - np.einsum("bij,bj->bi", C, x))
        keep = np.eye(3) - K @ C
        P = keep @ P @ keep.swapaxes(1, 2) + K @ R @ K.swapaxes(1, 2)
        ends = moved(f, (x[:, None] + 1j * STEP * np.eye(3)).reshape(-1, 3).T, 1, dt)[1]
        ends = ends.reshape(3, -1, 3)  # component × body × direction
        x, F = ends[..., 0].real.T, np.moveaxis(ends.imag, 0, 1) / STEP
        P = F @ P @ F.swapaxes(1, 2)
        found[k] = x
    return found
