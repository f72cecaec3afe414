"""The procedure of each preset.

A preset is a model in ``silmesh.settings.fit`` and the module of its name in this package.
"""

from importlib import import_module

from silmesh.fitting.loop import Procedure


def find_procedure(preset: str) -> type[Procedure]:
    """The class that a preset's module names as its ``PROCEDURE``; only this module is loaded.

    It is called with an initial mesh's vertices and faces, cameras, silhouettes, the preset's
    settings, and the views' weights or None.
    """
    return import_module(f"silmesh.fitting.{preset}").PROCEDURE
