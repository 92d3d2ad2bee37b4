"""Dump reader: layouts, order, and refusal of everything that is not a whole dump."""

import gzip
import struct
import tracemalloc

import numpy as np
import pytest
from fakes.analytic_flow import COLUMNS, binary_snapshot, text_snapshot
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from granpipe.dem.dump import first_step, read_dump, read_dumps, read_snapshot
from granpipe.dem.dump_binary import is_complete
from granpipe.errors import DataError

BOX = np.array([[-1.0, 1.0], [-1.0, 1.0], [0.0, 2.0]])


def particles(count=7, seed=0):
    rng = np.random.default_rng(seed)
    rows = rng.permutation(np.arange(1, count + 1))
    return np.column_stack([rows, np.ones(count), rng.uniform(-1, 1, (count, 6)), rng.uniform(0.01, 0.02, count)])


@pytest.fixture
def write(tmp_path):
    def write_file(content, name="dump.bin"):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write_file


@pytest.mark.parametrize("chunks", [1, 2, 5])
def test_binary_values_come_back_bit_for_bit_from_any_number_of_ranks(write, chunks):
    values = particles()
    snapshot = read_snapshot(write(binary_snapshot(4000, BOX, values, chunks)))
    assert snapshot.step == 4000
    assert np.array_equal(snapshot.box, BOX)
    assert np.array_equal(snapshot.values, values)
    assert np.array_equal(snapshot.position, values[:, 2:5])
    assert np.array_equal(snapshot.velocity, values[:, 5:8])
    assert np.array_equal(snapshot.radius, values[:, 8])
    assert snapshot.id.tolist() == values[:, 0].astype(int).tolist()


def test_header_is_the_documented_hundred_bytes(write):
    by_hand = struct.pack("<qqi", 12, 1, 0) + struct.pack("<6i", *[1] * 6) + struct.pack("<6d", -1, 1, -1, 1, 0, 2)
    by_hand += struct.pack("<ii", 9, 1) + struct.pack("<i", 9) + struct.pack("<9d", 3, 1, 0.1, 0.2, 0.3, 1, 2, 3, 0.05)
    assert len(by_hand) == 100 + 4 + 72
    snapshot = read_snapshot(write(by_hand))
    assert snapshot.position.tolist() == [[0.1, 0.2, 0.3]]
    assert snapshot.radius.tolist() == [0.05]


def test_a_snapshot_without_atoms_is_read(write):
    assert len(read_snapshot(write(binary_snapshot(1, BOX, particles(0))))) == 0


def test_several_binary_snapshots_in_one_file(write):
    path = write(b"".join(binary_snapshot(step, BOX, particles(seed=step), 2) for step in (10, 20, 30)))
    assert [snapshot.step for snapshot in read_dump(path)] == [10, 20, 30]
    with pytest.raises(DataError, match="3 snapshots"):
        read_snapshot(path)


@pytest.mark.parametrize("compress", [bytes, gzip.compress])
def test_text_is_told_by_its_content_and_names_its_columns(write, compress):
    values = particles(50)
    content = b"".join(text_snapshot(step, BOX, values + 0.0) for step in (0, 100))
    first, second = read_dump(write(compress(content), "post.liggghts"))
    assert (first.step, second.step) == (0, 100)
    assert second.columns == COLUMNS
    assert np.allclose(first.values, values, rtol=1e-5)
    assert np.array_equal(first.box, BOX)


def test_text_longer_than_a_block_keeps_every_row(write, monkeypatch):
    monkeypatch.setattr("granpipe.dem.dump_text._BLOCK", 1000)
    path = write(b"".join(text_snapshot(step, BOX, particles(200, step)) for step in range(3)), "long.txt")
    for step, snapshot in enumerate(read_dump(path)):
        assert np.allclose(snapshot.values, particles(200, step), rtol=1e-5)


def test_text_that_repeats_a_column_name_gives_the_first(write):
    # a dump line common in tutorials names the type twice
    values = np.array([[1, 2, 3, 0.1, 0.2, 0.3, 0.01]])
    path = write(text_snapshot(0, BOX, values, ("id", "type", "type", "x", "y", "z", "radius")), "t.txt")
    assert read_snapshot(path).column("type").tolist() == [2]


def test_files_are_read_in_the_order_of_their_steps_not_names(write):
    paths = [write(binary_snapshot(step, BOX, particles()), f"d.{step}.bin") for step in (1000, 200, 9000)]
    assert [snapshot.step for snapshot in read_dumps(paths)] == [200, 1000, 9000]
    assert first_step(paths[2]) == 9000


def test_a_step_that_a_restart_wrote_again_is_read_once(write):
    paths = [
        write(b"".join(binary_snapshot(step, BOX, particles()) for step in steps), f"{steps[0]}.bin")
        for steps in ((0, 10, 20), (20, 30))
    ]
    assert [snapshot.step for snapshot in read_dumps(paths)] == [0, 10, 20, 30]


def test_a_step_that_is_there_twice_with_other_particles_is_refused(write):
    other = particles()
    other[:, COLUMNS.index("vz")] *= 5
    for second in (other, particles()[:-1]):
        paths = [
            write(binary_snapshot(0, BOX, particles()), "a.bin"),
            write(binary_snapshot(0, BOX, second), "b.bin"),
        ]
        for order in (paths, paths[::-1]):
            with pytest.raises(DataError, match="step 0 is there twice, with other particles"):
                list(read_dumps(order))


def test_overlapping_files_are_refused(write):
    paths = [
        write(b"".join(binary_snapshot(step, BOX, particles()) for step in steps), f"{steps[0]}.bin")
        for steps in ((0, 10, 20), (15, 30))
    ]
    with pytest.raises(DataError, match="step 15 comes after step 20"):
        list(read_dumps(paths))


def test_every_truncation_is_refused_with_the_byte_and_seen_as_incomplete(write):
    whole = binary_snapshot(5, BOX, particles(3), 2)
    for length in range(1, len(whole)):
        path = write(whole[:length])
        assert not is_complete(path)
        with pytest.raises(DataError, match=f"truncated at byte {length}"):
            read_snapshot(path)
    assert is_complete(write(whole))


def test_an_empty_file_is_incomplete_and_refused(write):
    path = write(b"")
    assert not is_complete(path)
    with pytest.raises(DataError, match="empty"):
        read_snapshot(path)


def damaged(offset, layout, value, chunks=2):
    content = bytearray(binary_snapshot(5, BOX, particles(4), chunks))
    struct.pack_into(layout, content, offset, value)
    return bytes(content)


@pytest.mark.parametrize(
    ("offset", "layout", "value", "message"),
    [
        (0, "<q", -9, "negative step"),
        (8, "<q", -1, r"-1 atoms \(byte 8\)"),
        (16, "<i", 1, "triclinic"),
        (16, "<i", 7, "triclinic flag 7"),
        (20, "<i", 99, "boundary"),
        (44, "<d", np.nan, "box bounds"),
        (92, "<i", 0, r"0 columns \(byte 92\)"),
        (92, "<i", 2**30, "columns"),
        (96, "<i", 0, r"0 chunks \(byte 96\)"),
        (100, "<i", -18, r"claims -18 numbers \(byte 100\)"),
        (100, "<i", 17, r"claims 17 numbers \(byte 100\)"),
        (100, "<i", 2**31 - 1, "claims"),
        (100, "<i", 9, "hold 9 numbers"),
    ],
)
def test_inconsistent_binary_files_are_refused_with_the_byte(write, offset, layout, value, message):
    path = write(damaged(offset, layout, value))
    with pytest.raises(DataError, match=message) as caught:
        read_snapshot(path)
    assert str(path) in str(caught.value)


def test_a_huge_atom_count_is_refused_without_allocating_it(write):
    path = write(damaged(8, "<q", 2**40))
    tracemalloc.start()
    with pytest.raises(DataError, match="truncated"):
        read_snapshot(path)
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_give_a_snapshot_or_a_data_error_in_little_memory(write, data):
    start = data.draw(st.sampled_from([binary_snapshot(5, BOX, particles(4), 2), text_snapshot(5, BOX, particles(4))]))
    content = bytearray(start)
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = write(bytes(content) if data.draw(st.booleans()) else gzip.compress(content))
    tracemalloc.start()
    try:
        for snapshot in read_dump(path):
            assert snapshot.values.shape == (len(snapshot), len(snapshot.columns))
    except DataError:
        pass
    assert tracemalloc.get_traced_memory()[1] < 30_000_000  # a block of text, however it is read
    tracemalloc.stop()


def test_wrong_number_of_column_names_is_explained(write):
    path = write(binary_snapshot(5, BOX, particles()))
    with pytest.raises(DataError, match="9 columns, but 3 names"):
        read_snapshot(path, ("id", "x", "y"))


def test_columns_named_in_the_wrong_order_are_noticed(write):
    values = particles()
    path = write(binary_snapshot(5, BOX, values))
    with pytest.raises(DataError, match="'id' does not hold whole numbers"):
        read_snapshot(path, ("x", "y", "z", "id", "type", "vx", "vy", "vz", "radius"))
    with pytest.raises(DataError, match="'radius' is not positive"):
        read_snapshot(path, ("id", "type", "x", "y", "z", "vx", "vy", "radius", "vz"))


def test_columns_given_for_text_must_agree_with_it(write):
    path = write(text_snapshot(0, BOX, particles()), "t.txt")
    assert read_snapshot(path, COLUMNS).columns == COLUMNS
    with pytest.raises(DataError, match="not id,x as given"):
        read_snapshot(path, ("id", "x"))


def test_a_missing_column_is_named(write):
    path = write(text_snapshot(0, BOX, particles()[:, :5], COLUMNS[:5]), "t.txt")
    with pytest.raises(DataError, match="no column 'radius'"):
        _ = read_snapshot(path).radius


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-40], "expected below|truncated"),
        (lambda text: text[: text.rindex(b"\n", 0, -3) + 1], "6 of 7 atoms of step 0"),
        (lambda text: text.replace(b"ff ff ff", b"xy xz yz ff ff ff"), "triclinic"),
        (lambda text: text.replace(b"NUMBER OF ATOMS\n7", b"NUMBER OF ATOMS\n9999999999"), "do not fit"),
        (lambda text: text.replace(b"NUMBER OF ATOMS\n7", b"NUMBER OF ATOMS\n-7"), "whole number"),
        (lambda text: text.replace(b"NUMBER OF ATOMS\n7", b"NUMBER OF ATOMS\n6"), "expected 'ITEM: TIMESTEP'"),
        (lambda text: text.replace(b"ITEM: ATOMS id", b"ITEM: ATOMS id id"), "expected below"),
        (lambda text: text.replace(b"0.0", b"x", 1), "cannot be read|box bounds"),
        (lambda text: text[:60], "truncated"),
        (lambda text: text.rstrip(), "no line end, it may be cut in a number"),
        (lambda text: text.rstrip()[:-1], "no line end, it may be cut in a number|expected below|truncated"),
        (lambda text: gzip.compress(text)[:-30], "compressed data"),
        (lambda text: b"ITEM: TIMESTEP\n" + b"1" * 70000, "line without end"),
    ],
)
def test_damaged_text_is_refused_with_the_line(write, change, message):
    path = write(change(text_snapshot(0, BOX, particles())), "t.txt")
    with pytest.raises(DataError, match=message) as caught:
        list(read_dump(path))
    assert f"{path}:" in str(caught.value)


def test_columns_that_are_not_finite_are_refused(write):
    values = particles()
    values[3, 3] = np.inf
    with pytest.raises(DataError, match="'y' is not finite"):
        read_snapshot(write(binary_snapshot(5, BOX, values)))
