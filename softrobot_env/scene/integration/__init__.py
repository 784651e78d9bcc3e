"""How simulations are integrated in time.

`integrator` holds the settings and calls the compiled code. That is made of `extrapolation` (a
stretch of time, with its error), which takes the steps of `euler` with the `forces`, the `motors`
and the `friction` in the zones of `capstan`, and of `period` (a control period, what servos do in
it, a shadow's too, and what C code calls). `zones` tells Python of friction in one posture.
`layout` says where things stand in what is passed and in MuJoCo's structures, `mujoco_functions`
calls MuJoCo. `probe` measures.
"""
