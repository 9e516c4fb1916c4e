"""``python -m ddmhe``."""

from ddmhe.cli import main

main()
