"""Many environments at once beside single ones."""

import numpy as np

#: Tolerance of vectors, which are single precision.
SINGLE = {"rtol": 1e-7, "atol": 2e-6}


def same(one, several, i, **close):
    """Whether a result of a single environment, or a part of one, is the i-th of several."""
    if isinstance(one, dict):
        reported = [n for n in several if n[0] != "_" and several.get(f"_{n}", {i: True})[i]]
        assert list(one) == reported
        for name, value in one.items():
            same(value, several[name], i, err_msg=name, **close)
    elif isinstance(one, tuple):
        for mine, theirs in zip(one, several, strict=True):
            same(mine, theirs, i, **close)
    elif isinstance(one, str):
        assert several[i] == one
    else:
        assert several[i].dtype == np.asarray(one).dtype
        close |= SINGLE if several[i].dtype == np.float32 else {}
        np.testing.assert_allclose(several[i], one, **close)


def alike(many, singles, resets, rows, **close):
    """Results of many robots, after it was seen that some are those of single environments.

    Those whose episode is over begin the next one in the next step.

    Args:
        many: Their environment.
        singles: Environments by number.
        resets: What their resets returned: of many, and of the single ones by number.
        rows: Actions of all.
        close: Tolerance.
    """
    seen, alone = resets
    for i, one in alone.items():
        same(one, seen, i, **close)
    for row in rows:
        seen = many.step(row)
        for i, env in singles.items():
            if any(alone[i][2:4]):
                observation, info = env.reset()
                alone[i] = observation, 0.0, False, False, info
            else:
                alone[i] = env.step(row[i])
            same(alone[i], seen, i, **close)
        yield seen
