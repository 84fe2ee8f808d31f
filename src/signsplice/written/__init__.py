"""Converts signs as linguists write them (gestural SiGML, HamNoSys) to the notation of this project, and to motion."""
