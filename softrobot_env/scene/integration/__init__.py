"""How simulations are integrated in time.

`integrator` holds the settings and calls the compiled code. That is made of `extrapolation` (a
stretch of time, with its error), which takes the steps of `euler` with the `forces` and looks for
`switching` drives, and of `period` (a control period, a shadow's too, and what C code calls).
`layout` says where things stand in what is passed, `mujoco_functions` and `structs` where MuJoCo
keeps what is its own, `servos` what servos do in a period. `probe` measures.
"""
