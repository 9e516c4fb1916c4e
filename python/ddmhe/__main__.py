"""``python -m ddmhe``."""

from ddmhe.cli import main

if __name__ == "__main__":  # not where worker processes import it
    main()
