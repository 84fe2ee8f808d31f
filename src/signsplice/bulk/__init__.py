"""Sentences in bulk: makes shards from recipes, in processes of one machine or on a Ray cluster.

A recipe fully determines a sentence. A shard is the unit of work: one task makes all of it, so that its bytes depend
only on recipes, words, networks and options, not on the number of workers or on killed workers.
"""
