"""Sentences in bulk: recipes in, shards out, on the processes of one machine or on a Ray cluster.

A recipe says all that decides a sentence. A shard is the unit of work: one task makes it whole, so that its bytes
depend on recipes, words, networks and options alone, never on how many workers there are or which of them were killed.
"""
