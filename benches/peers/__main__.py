"""Times ddmhe beside every tool that a user could solve the same windows with: `make bench-peers`.

One process, one thread. Rounds: in each, every contestant in a new order solves a block of
consecutive windows; medians and 99th percentiles are over all windows of all rounds. Answers are
compared before they are timed."""

import os

# read by the libraries when they are loaded
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "RAYON_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

from compare import main  # noqa: E402

main()
