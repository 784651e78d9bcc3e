"""Studies of this package, for a checkout: not in the wheel.

A study is a `lab.Study`: cases, one function that measures, tables and pictures. `softrobot
benchmark NAME` runs one; `register` names them all, as any plug-in names its own.
"""

from softrobot_env.core.studies import register_study

#: Name -> what it measures.
STUDIES = {
    "accuracy": "Error against run time of all models, their agreement and goals",
    "contacts": "The timestep of contacts, and checks against exact solutions",
    "controllers": "All policies of the arm: as sec. 6.6 of the thesis, disturbed, on unseen paths",
    "drive": "Friction along tendons: accuracy, energy, cost, and policies that compensate it",
    "feedback": "Feedback of a late tip on the disturbed rig (thesis sec. 6.1)",
    "files": "Random robot files without `pieces`: error at rest, and what is reported",
    "first_order": "First-order policy learning, beside PPO in ten times the steps",
    "first_use": "The first minute: times and output of the first commands, with an empty cache",
    "gradients": "Derivatives of motions against differences of runs, and what they cost",
    "gripper": "The gripper: its grips, what it encloses, holds under pulls, and what they cost",
    "hardware": "Kinds of real hardware, emulated: safety, missed steps, and the error simulated",
    "identify": "Identification of robots of another model class, with hidden truths",
    "intervals": "Whether the intervals of an identification hold a recording that was kept back",
    "laws": "Every law on every robot, on generic paths at shares of the robot's first frequency",
    "learning": "Learning curves and figures of trained policies over several seeds",
    "peers": "Error and computing time beside SoRoMoX, and environment steps beside gym-softrobot",
    "ppo_defaults": "What PPO learns with the defaults of stable-baselines3",
    "reduction": "Reduced models of the rig, learned from its motion (thesis sec. 3.3.3)",
    "rig": "What sec. 5.4 of the thesis reports, run anew on twins of the rig",
    "rig_networks": "Quasi-static networks of the spatial rig: size, samples and cost",
    "scale": "What a million robot-seconds and a sweep on many cores cost, and where the time goes",
    "scenes": "Random scenes, stepped as environments step them, judged against refined runs",
    "sections": "Robots of sections and routed tendons against exact rods: error and run time",
    "sensing": "Curvature sensors as in chapter 4 of the thesis, and a better estimate of the tip",
    "speed": "Environment steps per second, what a step costs, and how long policies decide",
    "stability": "Which timestep, integrator, stiffness and damping hold",
    "thesis": "Figures and tables of the thesis' chapter 2 anew",
    "thesis_fitted": "How results depend on parameters that were fitted to the thesis",
    "thesis_text": "Numbers in the thesis' text that no other study measures",
    "tips": "Error and latency of tags seen by a camera, and of trackers' packets",
    "transfer": "Every policy on plants, robots and twins that it was not tuned on",
}

#: Name -> module and name in it, where it is not `STUDY` of the module of that name.
PLACES = {
    "accuracy": "accuracy.study:STUDY",
    "controllers": "policies:STUDY",
    "feedback": "rig:FEEDBACK",
    "laws": "laws:LAWS",
    "learning": "trainings:LEARNING",
    "ppo_defaults": "trainings:PPO_DEFAULTS",
    "rig": "rig:RIG_STUDY",
    "stability": "stability.study:STUDY",
    "transfer": "laws:TRANSFER",
}


def register() -> None:
    """Tell the registry of studies."""
    for name, about in STUDIES.items():
        register_study(name, f"studies.{PLACES.get(name, f'{name}:STUDY')}", about)
