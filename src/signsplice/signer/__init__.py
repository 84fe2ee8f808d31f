"""The synthetic signer: signs in notation -> plan -> motion of a skeleton."""
