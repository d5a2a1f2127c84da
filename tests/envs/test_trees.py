"""Rows of arrays, picked by their owners."""

import numpy as np

from envs.trees import first_rows


def test_the_first_row_of_each_owner_is_the_least_by_the_last_key_then_the_others():
    random = np.random.default_rng(3)
    for count in (0, 1, 40, 400):
        owners, minor, major = random.integers(0, 7, (3, count))
        best: dict[int, int] = {}
        for row in range(count):
            held = best.get(owners[row])
            if held is None or (major[row], minor[row]) < (major[held], minor[held]):
                best[owners[row]] = row
        found, rows = first_rows(owners, minor, major)
        assert found.tolist() == sorted(best)
        assert rows.tolist() == [best[owner] for owner in found.tolist()]
