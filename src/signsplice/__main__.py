"""``python -m signsplice``: the command line."""

from signsplice.cli import main

if __name__ == "__main__":
    main()
