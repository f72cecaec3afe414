"""Names that the configuration lists, since it imports nothing heavy, and what answers to them."""

from typing import get_args

from silmesh.settings import silhouettes
from silmesh.settings.init import Shape
from silmesh.settings.silhouettes import FOREGROUND_MODELS
from silmesh.shapes.initial import SHAPES
from silmesh.silhouettes import NETWORKS, SOURCES, weights
from silmesh.synthetic import dataset, layout


def test_every_source_of_silhouettes_can_be_configured():
    assert set(silhouettes.SOURCES) == {*SOURCES, *NETWORKS}


def test_every_foreground_model_that_can_be_configured_can_be_fetched():
    assert set(FOREGROUND_MODELS) == set(weights.MODELS)


def test_every_initial_mesh_can_be_configured():
    assert set(get_args(Shape)) == set(SHAPES)


def test_every_made_up_object_is_promised():
    assert set(layout.OBJECTS) == set(dataset._MODULES)
