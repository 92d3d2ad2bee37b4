"""Attacks on granpipe: hostile cases, drawings and files, with what is right stated beforehand."""

MODULES = ("cases", "drawings", "fields", "folders", "sweeps", "newest", "api", "surroundings")
"""Modules of attacks, each with a function `attacks()`; a new one gets a place in docs/validation/faults.md."""
