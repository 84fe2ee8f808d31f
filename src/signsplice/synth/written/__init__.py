"""Signs as linguists write them (gestural SiGML, HamNoSys) become the notation of this project."""

SUFFIXES = (".sigml", ".xml", ".csv", ".json", ".txt", ".tsv")
"""Suffixes of the files of written signs."""
