"""MuJoCo scenes of soft robots, built with MjSpec part by part."""
