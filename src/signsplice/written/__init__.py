"""Signs as linguists write them (gestural SiGML, HamNoSys) become the notation of this project."""

from signsplice.written.compiler import compile_sign

__all__ = ["compile_sign"]
