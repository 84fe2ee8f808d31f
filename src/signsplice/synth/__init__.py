"""The synthetic signer: signs in notation -> plan -> motion, with the ground truth of every splice."""
