"""What every part builds on: arrays, records, registries, files, runs of many jobs."""

__version__ = "0.2.0"
