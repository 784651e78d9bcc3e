"""The test rig as an exact upright column with a heavy head, and as a chain to compare with it."""

import numpy as np
from support.postures import posed

from softrobot_env.robots import RIG
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.statics import equilibrium

L, HEAD, G = RIG.length, RIG.head, 9.81
LEVER = 5.5e-3


def scene(robot=RIG, *, pieces=4, actuation="length", **options):
    config = SceneConfig(
        robot, pieces=pieces, actuation=actuation, bending="spatial", control_period=0.02, **options
    )
    return build_scene(config)


def tip_at(built, controls, **options):
    q = equilibrium(built.model, np.asarray(controls, float), **options)
    return posed(built.model, q).site("tip").xpos.copy()


class Column:
    """Small bending theta(s) = sum of q_i (s / L)^i of the upright rig, tendons held or free."""

    def __init__(self, terms, held):
        nodes, weights = np.polynomial.legendre.leggauss(30)
        s, weights = L * (nodes + 1) / 2, weights * L / 2
        i = np.arange(1, terms + 1)
        turn, bend = (s[:, None] / L) ** i, i * (s[:, None] / L) ** (i - 1) / L
        aside, self.end = s[:, None] ** (i + 1) / ((i + 1) * L**i), np.ones(terms)

        def integral(shape, weight):
            return np.einsum("k,ki,kj->ij", weights * weight, shape, shape)

        centre = L / (i + 1) + HEAD.centre * self.end
        at_end = np.outer(self.end, self.end)
        rho = RIG.mass_per_length
        self.mass = (
            integral(aside, rho)
            + integral(turn, RIG.density * RIG.second_moment)
            + HEAD.mass * np.outer(centre, centre)
            + HEAD.inertia[0] * at_end
        )
        self.elastic = integral(bend, RIG.bending_stiffness)
        self.gravity = G * (
            integral(turn, rho * (L - s) + HEAD.mass) + HEAD.mass * HEAD.centre * at_end
        )
        tendons = 1.5 * RIG.tendons[0].stiffness * LEVER**2 * at_end
        self.stiffness = self.elastic - self.gravity + tendons * held
        self.output = L / (i + 1) + HEAD.output * self.end

    def frequencies(self):
        """[rad/s] without damping."""
        squares = np.linalg.eigvals(np.linalg.solve(self.mass, self.stiffness)).real
        return np.sqrt(np.sort(squares))

    def damping_ratio(self):
        """Of the first mode."""
        n = len(self.end)
        damping = RIG.damping_time * self.elastic
        lower = -np.linalg.solve(self.mass, np.hstack((self.stiffness, damping)))
        roots = np.linalg.eigvals(np.vstack((np.eye(n, 2 * n, n), lower)))
        first = roots[np.argmin(np.abs(roots))]
        return -first.real / abs(first)

    def tip_per_moment(self):
        """[m/(N m)] of the output point, for a moment on the end."""
        return self.output @ np.linalg.solve(self.stiffness, self.end)
