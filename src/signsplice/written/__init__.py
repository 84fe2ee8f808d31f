"""Signs as linguists write them (gestural SiGML, HamNoSys) become the notation of this project, and motion."""
