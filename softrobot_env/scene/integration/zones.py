"""Friction along tendons in one posture, for Python; `capstan` says what zones are."""

import numpy as np
from mujoco import MjData, MjModel
from numpy import ndarray

from softrobot_env.compile.native import called, shared

from . import layout
from . import mujoco_functions as mj
from .capstan import list_zones
from .forces import chain_of

_STEP = 1e-7  # rad, of differences


@called
def _measure(model, data, header, course, found, slopes):
    """Zones in rows (3, elements), see `list_zones`, and slopes (elements or 0, nv)."""
    chain = shared(chain_of(model, data, header))
    count = list_zones(chain, course, found)
    if slopes.size == 0:
        return count
    kept, moved, way = chain.q.copy(), found.copy(), np.zeros(chain.v.size)
    for i in range(way.size):
        way[i] = 1.0
        mj.move(model, chain.q, way, _STEP)
        mj.mj_kinematics(model, data)
        list_zones(chain, course, moved)
        for k in range(count):
            slopes[k, i] = (moved[2, k] - found[2, k]) / _STEP
        way[i] = 0.0
        mj.assign(chain.q, kept)
    mj.mj_kinematics(model, data)
    return count


class Zones:
    """Where the tendons of a scene rub on their way.

    Attributes:
        drive: (zones,), which actuator pulls the tendon, from base to tip.
        first: (zones,), of the DOFs that move what lies beyond.
    """

    def __init__(self, model: MjModel) -> None:
        self._model, most = model, sum(number for _, number in layout.zones(model))
        sizes = (model.nq, model.nv, model.nu, model.nbody, model.ntendon)
        self._header = layout.header(sizes)
        self._header[layout.USER] = model.nuser_tendon
        self._course, self._found = np.zeros((5, model.nv + model.nbody)), np.zeros((3, most))
        self._slopes = np.zeros((most, model.nv))
        count = self._count(MjData(model), self._slopes[:0])
        self.drive, self.first = self._found[:2, :count].astype(int)

    def exponents(self, data: MjData) -> ndarray:
        """Logarithms (zones,) [1] of the largest ratio of tensions, of data with kinematics."""
        return self._found[2, : self._count(data, self._slopes[:0])].copy()

    def slopes(self, data: MjData) -> ndarray:
        """Their derivative (zones, nv) by small turns of the joints."""
        return self._slopes[: self._count(data, self._slopes)].copy()

    def _count(self, data: MjData, slopes: ndarray) -> int:
        if not self._found.size:
            return 0
        addresses = self._model._address, data._address
        return _measure(*addresses, self._header, self._course, self._found, slopes)
