"""What a camera's minute is worth after it: eight bodies of studies/reach.py and eight others,
torque for six minutes, and rates once a second for the first of them; beside the Cramér-Rao bound
with and without the camera. Writes two tables of docs/measured/reach.md."""

from dataclasses import dataclass

import numpy as np

import ddmhe
from bodies import DEG, RECORDED, Case, bodies, tumbled
from bound import Camera, bound, sensitivities
from ddmhe.report.page import markdown_table
from reach import everywhere, stated
from reach_asked import mean
from reach_page import put

SETS = (range(1000, 1008), range(9000, 9008))
"""Seeds."""
ONLINE = 3600
SPANS = {"60 s": slice(500, 600), "160 s": slice(1500, 1600), "360 s": slice(3300, 3600)}


@dataclass(frozen=True)
class Setting:
    """Noise, and how long is recorded and seen."""

    words: str
    noise: tuple[float, float, float]
    """Of recorded rates (rad/s), of torques (N m), of the camera (rad/s)."""
    recorded: int = RECORDED
    """Samples."""
    seen: int = 600

    @property
    def camera(self) -> Camera:
        return Camera(self.noise[2], self.seen)


ASKED = tuple(
    Setting(", ".join(f"{v:g}" for v in noise), noise)
    for noise in ((1e-4, 0.01, 1e-4), (1e-3, 0.01, 1e-4), (1e-3, 0.05, 1e-3))
)
OTHERS = (
    Setting("as above", ASKED[1].noise),
    Setting("a recording of 10 s", ASKED[1].noise, recorded=100),
    Setting("a camera for two minutes", ASKED[1].noise, seen=1200),
    Setting("a camera ten times as good", (1e-3, 0.01, 1e-5)),
    Setting("a recording ten times as noisy", (1e-2, 0.01, 1e-4)),
)
"""What else than the second of those may make a camera worth more."""


@dataclass(frozen=True, eq=False)
class Found:
    """Errors (deg/s) over SPANS without the camera and with it (2, 3), and the shares of errors of
    rates within two stated deviations (2)."""

    rms: np.ndarray
    within: np.ndarray


def over_spans(size):
    """Root mean squares (3, …) of |error| (N, …) over SPANS, in deg/s from rad/s."""
    return np.array([DEG * np.sqrt(np.mean(size[part] ** 2, axis=0)) for part in SPANS.values()])


def judged(logs, truth) -> Found:
    off = [np.abs(log.x - truth) for log in logs]
    within = [np.mean(e <= 2 * log.std) for e, log in zip(off, logs, strict=True)]
    return Found(np.array([over_spans(np.linalg.norm(e, axis=1)) for e in off]), np.array(within))


def estimated(job: tuple[Case, np.ndarray, float, bool]) -> dict[str, Found]:
    """What estimators make of a case without and with a camera's readings (N, 3) and their noise;
    `affine` asks for DdMhe, too, for which the camera is three more outputs."""
    case, camera, of_camera, affine = job
    found = {}
    if affine:
        x, y = case.x, case.y
        plain = ddmhe.DdMhe(ddmhe.History(x, np.hstack([y, x[:-1]]), dt=case.dt))
        logs = []
        for seen in (np.full_like(camera, np.nan), camera):
            plain.reset()
            logs.append(plain.run(np.hstack([case.Y, seen])))
        found["DdMhe"] = judged(logs, case.truth)
    for refit in ("now", "sliced"):
        settings = dict(refit=refit, rate_noise=of_camera, **stated(case))
        body = ddmhe.RigidBodyMhe(case.history, **settings)
        logs = [body.run(case.Y)]
        body.reset()
        logs.append(body.run(case.Y, X=camera))
        found[f"RigidBodyMhe, {refit}"] = judged(logs, case.truth)
    return found


def seen(x, y, setting, seed) -> tuple[Case, np.ndarray]:
    """A case of one body's rates and torques (N+1, 3), and what a camera reads beside it."""
    of_x, of_y, of_camera = setting.noise
    T, draw = setting.recorded, np.random.default_rng([99, seed])
    read, torque = (v + by * draw.standard_normal(v.shape) for v, by in ((x, of_x), (y, of_y)))
    noise = (of_x, of_y, of_y)
    case = Case(read[: T + 1], torque[:T], torque[T:-1], x[T + 1 :], noise)
    camera = x[T:-1] + of_camera * draw.standard_normal(case.Y.shape)
    camera[~setting.camera.sees(np.arange(len(camera)))] = np.nan
    return case, camera


def studied(seeds, setting, affine=False) -> dict[str, list[Found]]:
    """By estimator, a body each; the bound among them."""
    group = bodies(seeds)
    x, y = tumbled(group, setting.recorded + ONLINE)
    cases = [seen(x[:, k], y[:, k], setting, seed) for k, seed in enumerate(seeds)]
    logs = list(everywhere(estimated, [(*case, setting.noise[2], affine) for case in cases]))
    of = (*sensitivities(group, setting.recorded + ONLINE), [case for case, _ in cases])
    limits = [bound(*of, setting.recorded, camera=camera) for camera in (None, setting.camera)]
    limits = np.moveaxis(np.array([over_spans(limit) for limit in limits]), -1, 0)
    nothing = np.full(2, np.nan)
    found = {name: [one[name] for one in logs] for name in logs[0]}
    return found | {"bound": [Found(limit, nothing) for limit in limits]}


def errors(found, name):
    """Of all bodies without and with the camera over SPANS (B, 2, 3), deg/s."""
    return np.array([one.rms for one in found[name]])


def ratios(found, name):
    """The median ratio of errors with the camera to those without (3)."""
    rms = errors(found, name)
    return np.median(rms[:, 1] / rms[:, 0], axis=0)


def camera_table():
    """Of both sets what is asked."""
    rows = []
    for setting in ASKED:
        for seeds in SETS:
            found = studied(seeds, setting, affine=True)
            limit = errors(found, "bound")[:, 1, 2]
            for name, own in found.items():
                rms = errors(found, name)[:, 1]
                spans = zip(np.median(rms, axis=0), ratios(found, name), strict=True)
                cells = [f"{error:.2g} ({ratio:.2f})" for error, ratio in spans]
                off = f"{mean(rms[:, 2] / limit):.2f}" if "Rigid" in name else ""
                within = [one.within[1] for one in own]
                bars = "" if name == "bound" else f"{np.mean(within):.2f} ({np.min(within):.2f})"
                title = f"{seeds[0]} to {seeds[-1]}"
                rows.append((setting.words, title, name, *cells, off, bars))
    head = ("noise", "bodies", "estimator", *SPANS, "360 s, error / bound", "within 2 sd")
    return markdown_table(head, rows)


def others_table():
    """Ratios 360 s after the recording in other settings: the bound's, and those of estimators."""
    rows = []
    for setting in OTHERS:
        sets = [studied(seeds, setting) for seeds in SETS]
        names = ("bound", "RigidBodyMhe, now", "RigidBodyMhe, sliced")
        cells = [" ".join(f"{ratios(found, name)[2]:.3f}" for found in sets) for name in names]
        rows.append((setting.words, *cells))
    return markdown_table(("what differs", *names), rows)


def main():
    """Both tables."""
    put("camera", camera_table())
    put("other cameras", others_table())


if __name__ == "__main__":
    main()
