"""Rows of arrays, picked by their owners."""

import numpy as np

from envs.trees import first_rows


def test_the_first_row_of_each_owner_is_the_least_by_the_last_key_then_the_others():
    random = np.random.default_rng(3)
    for count in (0, 1, 40, 400):
        owners, minor, major = random.integers(0, 7, (3, count))
        best: dict[int, int] = {}
        for row in range(count):
            best_row = best.get(owners[row])
            if best_row is None or (major[row], minor[row]) < (major[best_row], minor[best_row]):
                best[owners[row]] = row
        first_owners, rows = first_rows(owners, minor, major)
        assert first_owners.tolist() == sorted(best)
        assert rows.tolist() == [best[owner] for owner in first_owners.tolist()]
