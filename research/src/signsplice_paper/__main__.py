"""``python -m signsplice_paper``: the command line."""

from signsplice_paper.cli import main

if __name__ == "__main__":
    main()
