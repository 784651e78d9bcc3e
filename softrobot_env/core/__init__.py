"""What every part builds on: arrays, records, registries, files, runs of many jobs."""
