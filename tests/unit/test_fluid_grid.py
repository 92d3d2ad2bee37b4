"""Finding grid nodes in a triangle mesh."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay

from granpipe.fluid.locate import locate


def test_nodes_of_two_triangles_are_found_with_their_local_coordinates():
    points = np.array([[0, 0], [2, 0], [2, 2], [0, 2.0]])
    triangle, place = locate(points, np.array([[0, 1, 3], [2, 3, 1]]), np.array([0.5, 1.5, 3]), np.array([0.25, 1.0]))
    np.testing.assert_array_equal(triangle, [[0, 0, -1], [0, 1, -1]])
    np.testing.assert_allclose(place[0, 0], [0.25, 0.125])
    np.testing.assert_allclose(place[1, 1], [0.25, 0.5])


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 10**6))
def test_every_node_in_the_hull_is_found_and_rebuilt_from_its_triangle(seed):
    random = np.random.default_rng(seed)
    points = np.concatenate([[[0, 0], [1, 0], [0, 1], [1, 1]], random.random((20, 2))])
    triangles = Delaunay(points).simplices
    r, z = np.linspace(0, 1.2, 13), np.linspace(-0.1, 1, 12)
    triangle, place = locate(points, triangles, r, z)
    radius, height = np.meshgrid(r, z)
    np.testing.assert_array_equal(triangle >= 0, (radius <= 1 + 1e-9) & (height >= -1e-9))
    a, b, c = points[triangles[triangle]].transpose(2, 0, 1, 3)
    rebuilt = a + place[..., :1] * (b - a) + place[..., 1:] * (c - a)
    found = triangle >= 0
    np.testing.assert_allclose(rebuilt[found], np.stack([radius, height], axis=2)[found], atol=1e-12)
    assert place[found].min() >= -1e-9
    assert place[found].sum(axis=1).max() <= 1 + 1e-9
