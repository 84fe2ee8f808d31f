"""Lexicons: gloss -> clip. Built once from clips, opened in milliseconds; one ships with the package."""

from signsplice.lexicon.builder import Builder, building
from signsplice.lexicon.entry import Entry
from signsplice.lexicon.folder import build
from signsplice.lexicon.reader import Lexicon, open_lexicon, shipped

open = open_lexicon

__all__ = ["Builder", "Entry", "Lexicon", "build", "building", "open", "open_lexicon", "shipped"]
