"""``python -m signsplice.cli``."""

from signsplice.cli import main

if __name__ == "__main__":
    main()
