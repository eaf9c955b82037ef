"""What is kept of a run: rows that stay as they were drawn from, and values that come after their row."""

import numpy as np

from canarm_tui.history import COLUMNS, Column
from canarm_tui.rings import ReferenceRing, RowStore


def row(value, joints=1):
    return np.full((joints, COLUMNS), value, dtype=np.float32)


def filled(count, capacity=10):
    store = RowStore(capacity, 1)
    for cycle in range(count):
        store.append(cycle, row(cycle))
    return store


def test_the_last_rows_are_kept_in_order_however_many_have_come():
    for count in (3, 10, 19, 20, 21, 57):
        cycles = filled(count).history().cycles.tolist()
        assert cycles == list(range(max(0, count - 10), count)), count


def test_what_somebody_draws_from_does_not_change_when_the_memory_begins_anew():
    store = filled(19)
    held = store.history()
    for cycle in range(19, 60):
        store.append(cycle, row(-1.0))
    store.clear()
    assert held.cycles.tolist() == list(range(9, 19))
    assert held.values[:, 0, Column.ANGLE].tolist() == list(range(9, 19))
    assert not store.history().cycles.size


def test_a_stretch_has_both_of_its_ends_and_a_moment_the_row_before_it():
    history = filled(10).history()
    assert history.between(3, 5).cycles.tolist() == [3, 4, 5]
    assert history.between(20, 30).cycles.size == 0
    assert (history.row_at(7), history.row_at(-1), history.row_at(99)) == (7, None, 9)


def test_references_and_reports_find_their_rows_afterwards():
    store, references = RowStore(10, 1), ReferenceRing(20, 1)
    for cycle in (0, 4, 8):
        values = row(np.nan)
        values[0, Column.ANGLE] = 2.0
        store.append(cycle, values)
    references.put(0, 4, 1.5)
    store.fill_references(references, 10, np.array([0.25]))
    store.put(8, 0, Column.MEASURED, (3.0, 4.0))
    store.put(6, 0, Column.MEASURED, (9.0, 9.0))
    values = store.history().values[:, 0]
    np.testing.assert_array_equal(values[:, Column.ERROR], [np.nan, 2.0, np.nan])
    np.testing.assert_array_equal(values[:, Column.MEASURED], [np.nan, np.nan, 3.0])
    assert values[2, Column.MEASURED_SPEED] == 4.0
