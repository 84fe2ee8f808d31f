"""How fast every part is, the service under load, and sentences in bulk."""
