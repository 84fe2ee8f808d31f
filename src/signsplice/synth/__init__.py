"""The signer that makes true data: signs in notation -> plan -> motion, with the exact truth of every splice."""
