"""Pictures and films of a clip's signer."""
