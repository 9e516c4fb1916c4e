"""Settings from the recording alone, and a certificate that says how errors shrink.

`tune` leaves the default rule only where the recording shows beyond doubt that something else is
better; a certificate holds for the system that the recording shows."""

import numpy as np

import ddmhe


def main() -> None:
    """Tune on a simulated bench, then certify a linear system and bound its errors."""
    record = ddmhe.models.spin_down().simulate(6.0, 0.01, noise=1e-3)
    tuned = ddmhe.tune(record.history(300), progress=False)
    print(f"tune: {tuned.settings or 'the default rule'}, start {tuned.start!r}")
    lo, hi = tuned.range
    print(
        f"promised error {tuned.promise[0]:.2g} rad/s, later errors from {lo[0]:.2g} to {hi[0]:.2g}"
    )

    A = np.array([[0.99, 0.1], [-0.1, 0.99]])
    x = [np.array([1.0, 0.0])]
    for _ in range(160):
        x.append(A @ x[-1])
    states = np.array(x)
    outputs = states[:-1, :1]
    history = ddmhe.History(states[:61], outputs[:60], 0.1)
    certificate = ddmhe.design.ioss(history, eta=0.9)
    print(
        f"certificate: largest eigenvalue of its inequality {certificate.residual:.1e}, at most 0 "
        "is wanted"
    )
    settings = {"horizon": 20, "certificate": certificate, "disturbance": (0.5, 0.0, 0.02)}
    estimator = ddmhe.DdMhe(history, x_prior=states[60] + [0.3, -0.3], **settings)
    noise = 0.02 * np.random.default_rng(1).uniform(-1, 1, (100, 1))
    log = estimator.run(outputs[60:] + noise)
    error = np.linalg.norm(log.x - states[61:], axis=1)
    print(f"error after 100 steps {error[-1]:.4f}, bounded by {log.bound[-1]:.4f}")
    print(f"largest error over its bound: {np.max(error / log.bound):.2f}")


if __name__ == "__main__":
    main()
