"""Solutions along the bodies against MuJoCo's mass matrix."""

import mujoco
import numpy as np
import pytest

from softrobot_env.compile.native import called, shared
from softrobot_env.scene.integration.articulated import SIDE, Tree, factorize, runs, solve

#: Two trees with branches, several joints on a body, and bodies that are welded on.
TREES = """<mujoco><worldbody>
<body><joint type="slide" axis="1 0 0"/><joint axis="0 1 0"/><joint axis="1 0 0"/>
  <geom size=".1" pos=".1 .2 .3"/>
  <body pos="0 0 1"><geom size=".2 .1 .3" type="box" euler="10 20 30"/>
    <body pos=".3 0 .5"><joint type="ball"/><geom size=".1 .2" type="capsule" pos="0 .1 .2"/></body>
    <body pos="0 .2 .4"><joint axis="0 1 1" pos=".1 0 0"/><geom size=".1"/>
      <body pos="0 0 .4"><joint axis="1 1 0"/><geom size=".15"/></body></body>
  </body></body>
<body pos="2 0 0"><freejoint/><geom size=".1 .2" type="cylinder" pos="0 .1 0"/>
  <body pos="0 0 1"><joint axis="1 0 0" armature=".3"/><geom size=".1"/></body></body>
</worldbody></mujoco>"""


@called
def solve_all(tree, axes, inertias, diagonal, columns, count):
    """Columns (nv, groups) become solutions; compiled code is called by compiled code."""
    held = shared(tree)
    factorize(held, axes, inertias, diagonal)
    solve(held, columns, count)


@pytest.mark.parametrize("count", [1, 3, SIDE, SIDE + 2])
def test_trees_of_any_joints_are_solved(count):
    model = mujoco.MjModel.from_xml_string(TREES)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for i in range(model.nv):
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv) * np.eye(model.nv)[i], 1)
    mujoco.mj_forward(model, data)
    diagonal = rng.uniform(0, 0.1, model.nv)
    columns = rng.normal(size=(model.nv, -(-count // SIDE) * SIDE))
    mass = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    truth = np.linalg.solve(mass + np.diag(diagonal), columns[:, :count])
    nv, run = model.nv, runs(model.body_parentid)
    tree = Tree(
        *(model.body_parentid, model.body_dofadr, model.body_dofnum, run),
        *(np.empty((nv, 6)), np.empty((nv, 6)), np.empty(nv)),
        *(np.empty((run[0], 21)), np.empty((-(-count // SIDE) * run[0], 6 * SIDE))),
    )
    resistance = diagonal + model.dof_armature
    solve_all(tree, data.cdof.ravel(), data.cinert.ravel(), resistance, columns, count)
    np.testing.assert_allclose(columns[:, :count], truth, rtol=1e-11, atol=1e-12)
