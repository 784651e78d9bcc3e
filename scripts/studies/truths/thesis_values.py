"""Numbers of chapters 2 and 6 of the thesis, and those the audit recomputed; SI units."""

#: Numbers of pieces of most tables.
_FEW, _MANY = (1, 2, 3, 5, 8), (1, 2, 3, 4, 5, 8, 14, 20)


def _by(pieces: tuple[int, ...], *numbers: float) -> dict[int, float]:
    """Number of pieces -> number."""
    return dict(zip(pieces, numbers, strict=True))


#: Tip deflection [m] under self-weight by parameter set, model and number of pieces (audit).
DEFLECTION = {
    ("weak", "pcc"): _by(_FEW, 0.3208, 0.3680, 0.3788, 0.3846, 0.3865),
    ("weak", "cosserat"): _by(
        _MANY, 0.4824, 0.4507, 0.4265, 0.4133, 0.4063, 0.3983, 0.3947, 0.3937
    ),
    ("weak", "ancf"): _by(_MANY, 0.1568, 0.2771, 0.3417, 0.3677, 0.3797, 0.3906, 0.3934, 0.3939),
    ("stiff", "pcc"): _by(_FEW, 0.01267, 0.01269, 0.01270, 0.01270, 0.01270),
    ("stiff", "cosserat"): _by(
        _MANY, 0.02659, 0.01721, 0.01546, 0.01484, 0.01456, 0.01425, 0.01412, 0.01408
    ),
    ("stiff", "ancf"): _by(
        _MANY, 0.00925, 0.01254, 0.01317, 0.01340, 0.01351, 0.01363, 0.01368, 0.01370
    ),
}

#: The same of the stiff set with ANCF's Poisson ratio of 0.49, by law of the plane, for 20 pieces.
LOCKED_DEFLECTION = {"stress": 0.01116, "strain": 0.00224}

#: Tip deflection [m] of beam theories: straight-line, and geometrically exact ones.
DEFLECTION_THEORY = {
    ("stiff", "euler_bernoulli"): 0.012739,
    ("stiff", "timoshenko"): 0.014098,
    ("weak", "elastica"): 0.38778,
    ("stiff", "elastica"): 0.012698,
    ("weak", "exact_rod"): 0.39273,
    ("stiff", "exact_rod"): 0.014050,
    ("weak", "exact_rod_k1"): 0.39202,
    ("stiff", "exact_rod_k1"): 0.013713,
}

#: First bending frequency [Hz] by parameter set, model and number of pieces (audit).
FREQUENCY = {
    ("weak", "pcc"): {1: 0.5290, 3: 0.6382, 5: 0.6505, 14: 0.6566},
    ("weak", "cosserat"): {1: 0.3735, 3: 0.5997, 5: 0.6330, 14: 0.6511},
    ("weak", "ancf"): {1: 0.8311, 3: 0.6692, 5: 0.6599, 14: 0.6554},
    ("stiff", "pcc"): {1: 4.331, 3: 5.209, 5: 5.310, 14: 5.359},
    ("stiff", "cosserat"): {1: 3.016, 3: 4.706, 5: 4.940, 14: 5.065},
    ("stiff", "ancf"): {1: 6.426, 3: 5.266, 5: 5.195, 14: 5.158},
}

#: First bending frequency [Hz] of beam theories.
FREQUENCY_THEORY = {
    ("weak", "euler_bernoulli"): 0.6588,
    ("stiff", "euler_bernoulli"): 5.4903,
    ("weak", "timoshenko"): 0.6539,
    ("stiff", "timoshenko"): 5.084,
}

#: Torsional frequency [Hz] of the weak set by Poisson ratio: exact, and of PCC and the Cosserat
#: rod by number of pieces.
TORSION_FREQUENCY = {0.0: 6.938, 0.49: 5.684}
TORSION_FREQUENCY_LUMPED = {1: 6.246, 2: 6.761, 3: 6.859, 5: 6.909}

#: Torsional frequency [Hz] that the printed factor 4 in (2.44) gives instead of 1/4.
TORSION_FREQUENCY_PRINTED = 27.7

#: Twist [rad] that (2.77) prints for 0.1 N m; it belongs to 0.01 N m and a Poisson ratio of 0.
TWIST, TWIST_AS_PRINTED = 0.01908, 0.1908

#: Tip deflection [m] by weighting xi_1 to xi_5 with printed moments (audit).
WEIGHTINGS = {
    3: (0.42795, 0.42645, 0.42214, 0.42500, 0.42597),
    5: (0.40690, 0.40632, 0.40460, 0.40574, 0.40613),
}

#: Spread [m] of the deflections over the weightings: thesis, audit with printed moments, and
#: audit with moments that conserve energy.
SPREAD_THESIS = {3: 5.82e-3, 5: 2.3e-3}
SPREAD_PRINTED = {3: 5.81e-3, 5: 2.30e-3}
SPREAD_CONSERVATIVE = {3: 20.2e-3, 5: 8.7e-3}

#: Difference [m] of the deflections of 3 and 5 pieces; it is that of xi_1, not of xi_2.
REFINEMENT_THESIS = 21.1e-3
REFINEMENT = {1: 21.05e-3, 2: 20.1e-3}

#: Largest violation of the quaternions' norm with projection, by tolerance from loose to strict.
DRIFT = (3.88e-5, 1.35e-5)

#: First order of Gauss-Legendre integration with an error below 1e-3, and its time [s].
ORDER, ORDER_TIME = 8, 0.23e-3

#: Fewest pieces for a deflection of the weak set within 5 % of the converged one.
PIECES_FOR_5_PERCENT = {"pcc": 3, "cosserat": 5, "ancf": 5}

#: Error of PCC with one piece to Euler-Bernoulli, stiff set, from the deflections above.
ONE_PIECE_ERROR = 0.01267 / 0.012739 - 1

#: Bounds of the differences at 14 pieces: between the models, and to Euler-Bernoulli.
MODEL_SPREAD, THEORY_DISTANCE = 0.005, 0.04
THEORY_DISTANCE_AUDIT = {
    ("weak", "all"): 0.012,
    ("stiff", "pcc"): -0.024,
    ("stiff", "cosserat"): -0.078,
    ("stiff", "ancf"): -0.061,
}

#: Most pieces with which ANCF simulates faster than real time, planar and spiral; number of
#: pieces above which PCC needs more evaluations than ANCF.
REALTIME_ANCF, REALTIME_ANCF_SPIRAL, PCC_NEEDS_MORE = 3, 1, 11

#: Spiral: largest radius [m] and tip [m] at the end, by model and number of pieces (audit).
SPIRAL_RADIUS = {
    "pcc": {1: 0.0504, 2: 0.0599, 3: 0.0615, 4: 0.0620, 5: 0.0623},
    "cosserat": {7: 0.0689, 20: 0.0682},
    "ancf": {2: 0.0623, 4: 0.0665, 8: 0.0674},
}
SPIRAL_TIP = {
    ("pcc", 5): (-0.0618, 0.0077, 0.1879),
    ("cosserat", 20): (-0.0677, 0.0084, 0.1867),
    ("ancf", 8): (-0.0669, 0.0083, 0.1859),
}

#: Mean and largest distance [m] to the mean of the three models (audit), and the thesis' bounds
#: for the finest models and for those of Tab. 2.2.
SPIRAL_DISTANCE = {
    ("pcc", 5): (1.9e-3, 3.8e-3),
    ("cosserat", 20): (1.3e-3, 2.2e-3),
    ("ancf", 8): (0.7e-3, 1.7e-3),
    ("ancf", 4): (0.25e-3, 0.8e-3),
}
FINEST_BOUND, CHOSEN_BOUND = (0.9e-3, 1.6e-3), (2e-3, 5e-3)

#: Pieces that the thesis chooses for Tab. 2.2 and 2.3.
CHOSEN = {"pcc": 2, "cosserat": 7, "ancf": 2}

#: Accuracies [m] of Tab. 2.2: of the adaptive solvers, and of implicit Euler (audit: metres).
ADAPTIVE_ACCURACY, EULER_ACCURACIES = 0.9e-3, (10e-3, 1e-3, 0.1e-3)

#: Tab. 2.2: computation times [s] of ode15s, ode45, and of implicit Euler by accuracy.
TIMES = {
    "pcc": (0.105, 0.106, (0.0633, 0.263, 2.35)),
    "cosserat": (0.828, 21.2, (0.301, 1.26, 9.88)),
    "ancf": (9.69, 57.9, (24.0, 40.6, 377.0)),
}

#: Tab. 2.3: smallest and largest steps [s] of ode15s and ode45, and steps of implicit Euler. The
#: columns of the adaptive solvers are exchanged for the Cosserat rod and ANCF (audit).
STEPS = {
    "pcc": ((2.9e-6, 9.5e-4), (2.9e-6, 9.5e-4), (1.6e-1, 2.4e-2, 2.0e-3)),
    "cosserat": ((4.1e-7, 1.2e-2), (9.7e-7, 7.3e-4), (1.7e-1, 2.5e-2, 2.5e-3)),
    "ancf": ((3.4e-5, 2.1e-2), (5.4e-6, 2.5e-5), (1.7e-1, 3.0e-2, 2.0e-3)),
}

#: Mean and largest error [m] of implicit Euler with PCC at the printed steps (audit). 0.16 s does
#: not divide 3 s, so that the first ones hold for another last step than equal ones.
EULER_ERRORS = ((4.6e-3, 20.8e-3), (0.86e-3, 1.38e-3), (0.11e-3, 0.22e-3))

#: The thesis' name of a controller by that of our policy.
CONTROLLERS = {"qs_nn": "quasi-static", "lqi": "LQI", "mpc": "MPC"}

#: What sec. 6.6.3 says of the swing with a factor [1] on Young's modulus of the plant.
ROBUSTNESS = {
    "quasi-static": {0.5: "lost", 0.75: "lost", 1.25: "as nominal", 1.5: "as nominal"},
    "LQI": {0.5: "robust", 0.75: "robust", 1.25: "robust", 1.5: "robust"},
    "MPC": {0.5: "fails", 0.75: "z too small", 1.25: "z too large", 1.5: "z too large"},
}

#: Step width [m] and controller -> ranges of rise and settling time [s] and of the overshoot, and
#: of the steady-state error where it was told, by an independent recomputation with corrected
#: equations (audit).
_AUDIT_STEPS = {
    (0.05, "quasi-static"): ((0.24, 0.24), (5.6, 12.0), (0.61, 0.69), (0.001, 0.016)),
    (0.05, "LQI"): ((0.080, 0.096), (0.69, 0.76), (0.31, 0.35), (1e-4, 1e-4)),
    (0.05, "MPC"): ((0.09, 0.09), (0.85, 0.85), (0.28, 0.28), (1e-4, 1e-4)),
    (0.1, "quasi-static"): ((0.24, 0.24), (5.2, 14.0), (0.59, 0.67)),
    (0.1, "LQI"): ((0.081, 0.081), (0.68, 0.68), (0.30, 0.30)),
    (0.1, "MPC"): ((0.09, 0.09), (1.02, 1.02), (0.29, 0.29)),
    (0.2, "quasi-static"): ((0.24, 0.24), (5.0, 20.0), (0.52, 0.63)),
    (0.2, "LQI"): ((0.082, 0.082), (0.65, 0.65), (0.27, 0.27)),
    (0.2, "MPC"): ((0.09, 0.09), (1.01, 1.01), (0.29, 0.29)),
}
_STEP_METRICS = ("rise_time", "settling_time", "overshoot", "steady_state_error")

#: Smallest and largest figure of the audit, by task, step width [m] and controller; names and units
#: are those of `ThesisFigure`. A steady-state error of 1e-4 is an upper bound.
AUDIT: dict[tuple[str, float | None, str], dict[str, tuple[float, float]]] = {
    **{
        ("step", *case): dict(zip(_STEP_METRICS, ranges, strict=False))
        for case, ranges in _AUDIT_STEPS.items()
    },
    ("swing", None, "quasi-static"): {"e_max": (14e-3, 18e-3), "e_motion": (5e-3, 5e-3)},
    ("swing", None, "LQI"): {"e_max": (5.9e-3, 6.7e-3), "e_motion": (0.3e-3, 0.4e-3)},
    ("swing", None, "MPC"): {"e_max": (12.8e-3, 12.8e-3), "e_motion": (8.9e-3, 8.9e-3)},
    ("lshape", None, "quasi-static"): {"e_max": (22e-3, 28e-3)},
    ("lshape", None, "LQI"): {"e_max": (1.9e-3, 2.1e-3)},
    ("lshape", None, "MPC"): {"e_max": (2.6e-3, 2.6e-3)},
}
