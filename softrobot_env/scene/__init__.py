"""MuJoCo scenes of soft robots, built with MjSpec part by part: see `config`, then `build`."""
