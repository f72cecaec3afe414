"""What a run makes: every object with every variant, and the stages that variants share.

A stage's folder is named by all that it depends on, so two variants that agree up to a stage
share it:

    results/<object>/stages/views/256-pad/
                            silhouettes/256-pad-mask/, silhouettes/256-pad-deeplab_1a2b3c4d/
                            features/1600-4096/
                            matches/1600-4096-exhaustive-0/
                            models/1600-4096-exhaustive-0-incremental/
                            cameras/256-pad-turntable/, cameras/256-pad-mask-calibrate/
                            scenes/256-pad-mask-turntable/
                            judged/256-pad-mask-turntable-keep-3/
                            first/256-pad-mask-turntable-keep-3-sphere-1352-bbox/
    results/<object>/<variant>/

This module is read by the Snakefile each time, so it imports nothing heavy.
"""

import re
import zlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from silmesh.cameras.locate import locate
from silmesh.cameras.sets import describe_unused
from silmesh.errors import InputError, blaming
from silmesh.own_code import own_file, own_files, refuse_lacking
from silmesh.planning.config import Config, Variant, parse_config
from silmesh.planning.datasets import Dataset, read_datasets, resolve_cameras
from silmesh.planning.experiments import Member, expand
from silmesh.planning.feasible import (
    refuse_infeasible,
    refuse_lacking_backgrounds,
    refuse_lacking_mesh,
    refuse_other_weights,
    refuse_unknown_weights,
)
from silmesh.reading import is_array
from silmesh.remote.address import FOLDER, KEY, Address
from silmesh.report.published import check_published
from silmesh.settings.fit import is_photometric
from silmesh.settings.init import mesh_file
from silmesh.settings.section import NAME, Section
from silmesh.settings.silhouettes import FOREGROUND_MODELS, Networks, weights_file
from silmesh.settings.train import NEW, TRAINED
from silmesh.settings.turntable import Turntable

FOUND = ("calibrate", "colmap", "auto")  # sources that look at the silhouettes
COLMAP = {  # the attempts of COLMAP's, by whether it masks
    "none": ("colmap",),
    "silhouettes": ("colmap_masked",),
    "auto": ("colmap_masked", "colmap_fallback"),
}
FOLDERS = {  # of an object's stages
    "views": "views",
    "silhouettes": "silhouettes",
    "features": "features",
    "matches": "matches",
    "model": "models",
    "cameras": "cameras",
    "scene": "scenes",
    "judged": "judged",
    "initial": "first",
}
NEVER = "(?!)"  # matches nothing


@dataclass(frozen=True)
class Run:
    """One object with one variant, everything decided that names its stages.

    Attributes:
        member: the variant, and which experiment's replicate it is
        settings: of all stages
        silhouettes, cameras: where they come from
        published: the variant whose published curve it repeats, if there is one
    """

    dataset: Dataset
    member: Member
    settings: Variant
    silhouettes: str
    cameras: str
    published: str

    @property
    def variant(self) -> str:
        """The variant's name."""
        return self.member.name

    def keys(self, stage: str) -> tuple[str, ...]:
        """What a stage, one of ``FOLDERS``, is called; of cameras there may be several attempts."""
        return self.cameras_keys if stage == "cameras" else (getattr(self, f"{stage}_key"),)

    def folders(self, stage: str) -> list[str]:
        """Where a stage lies: each of its folders."""
        stages = f"results/{self.dataset.object}/stages/{FOLDERS[stage]}"
        return [f"{stages}/{key}" for key in self.keys(stage)]

    def folder(self, stage: str) -> str:
        """Where a stage lies that has one folder."""
        (folder,) = self.folders(stage)
        return folder

    @property
    def names(self) -> dict[str, Sequence[str]]:
        """The values of the wildcards that keys are put together from in the rules."""
        attempts = [key.removeprefix(f"{self.silhouettes_key}-") for key in self.cameras_keys]
        masked = [name.split("_")[1] for name in attempts if name.count("_") == 2]
        return {
            "views": self.keys("views"),
            "source": [self._silhouettes_name],
            "cameras": [self._cameras_name] if self.cameras not in FOUND else [],
            "calibration": [name for name in attempts if name == self._calibrate_name],
            "features": self.keys("features"),
            "matches": self.keys("matches"),
            "model": self.keys("model"),
            "masks": masked,
            "digest": [_digest(self.model_key)],
            "scene": self.keys("scene"),
            "judged": self.keys("judged"),
            "initial": self.keys("initial"),
        }

    @property
    def views_key(self) -> str:
        """Names the working images."""
        return f"{self.settings.views.size}-{self.settings.views.resize}"

    @property
    def silhouettes_key(self) -> str:
        """Names the silhouettes; a network's settings by a short digest."""
        return f"{self.views_key}-{self._silhouettes_name}"

    @property
    def cameras_keys(self) -> tuple[str, ...]:
        """Names the attempts at cameras; a file by a short digest of its path.

        Cameras that are found from silhouettes, or judged by them, depend on these too.
        """
        if self.cameras not in FOUND:
            return (f"{self.views_key}-{self._cameras_name}",)
        found = []
        if self.cameras in ("colmap", "auto"):
            found += [
                f"{name}_{_digest(self.model_key)}" for name in COLMAP[self.settings.colmap.masks]
            ]
        if self.cameras in ("calibrate", "auto"):
            found += [self._calibrate_name]
        return tuple(f"{self.silhouettes_key}-{name}" for name in found)

    @property
    def sparing(self) -> list[str]:
        """Folders of the attempts at cameras that may make one from silhouettes needless."""
        return self.folders("cameras")[:-1] if self._spares_calibrate else []

    @property
    def features_key(self) -> str:
        """Names the features of the photographs."""
        return f"{self.settings.colmap.max_size}-{self.settings.colmap.features}"

    @property
    def matches_key(self) -> str:
        """Names the matches of the features."""
        return f"{self.features_key}-{self.settings.colmap.matching}-{self.settings.colmap.seed}"

    @property
    def model_key(self) -> str:
        """Names the COLMAP model."""
        return f"{self.matches_key}-{self.settings.colmap.mapping}"

    @property
    def scene_key(self) -> str:
        """Names silhouettes and cameras together."""
        return f"{self.silhouettes_key}-{self._cameras_name}"

    @property
    def judged_key(self) -> str:
        """Names the scene after its outliers were kept, dropped or repaired."""
        return f"{self.scene_key}-{self.policy}-{self.settings.quality.fewest}"

    @property
    def initial_key(self) -> str:
        """Names the initial mesh."""
        return f"{self.judged_key}-{self.settings.init.key}"

    @property
    def silhouettes_own(self) -> list[Path]:
        """The file of a person's own code that finds the silhouettes, if it does."""
        return own_files(self.silhouettes)

    @property
    def initial_own(self) -> list[Path]:
        """The file of a person's own that the initial mesh is made by or read from, if it is."""
        shape = self.settings.init.shape
        return [*own_files(shape), *filter(None, [mesh_file(shape)])]

    @property
    def fit_own(self) -> list[Path]:
        """The files of a person's own code that fits or renders, if it does."""
        return own_files(self.settings.fit.preset, self.settings.fit.renderer)

    @property
    def textured(self) -> bool:
        """Whether the mesh gets a texture, and not colours of its vertices alone."""
        return self.settings.texture.wanted

    @property
    def photometric(self) -> bool:
        """Whether photographs have a say in the fitted mesh."""
        return is_photometric(self.settings.fit)

    @property
    def policy(self) -> str:
        """What is done with outliers: ``keep``, ``drop`` or ``repair``."""
        return self.settings.quality.policy

    @property
    def masks(self) -> tuple[Path, ...]:
        """The mask files that the silhouettes are read from, if they are."""
        return self.dataset.masks if self.silhouettes == "mask" else ()

    @property
    def network(self) -> Section | None:
        """The settings of the network that the silhouettes come from, if they do."""
        known = self.silhouettes in Networks.model_fields
        return getattr(self.settings, self.silhouettes) if known else None

    @property
    def weights_file(self) -> Path | None:
        """The file of the network's weights, if the silhouettes come from one."""
        return self.network.weights_file if self.network else None

    @property
    def camera_file(self) -> Path | None:
        """The file or folder that the cameras are read from, if they are."""
        kind, _, path = self.cameras.partition(":")
        return Path(path) if kind == "file" else None

    @property
    def camera_files(self) -> tuple[Path, ...]:
        """What is read of it."""
        return locate(self.camera_file).files if self.camera_file else ()

    @property
    def turntable(self) -> Turntable | None:
        """What is known of the turntable, if the cameras come from it."""
        return self.dataset.turntable if self.camera_file is None else None

    @property
    def keeps_world(self) -> bool:
        """Whether the cameras' world is normalised by its definition.

        A turntable's distances and SoftRas's are in units in which the object has about size 1.
        """
        if self.camera_file is None:
            return self.cameras == "turntable"
        return locate(self.camera_file).kind == "softras"

    @property
    def estimates_cameras(self) -> bool:
        """Whether the cameras are found from the pictures, so that their frame is arbitrary."""
        return self.cameras in FOUND

    @property
    def _calibrate_name(self) -> str:
        name = "calibrate" if self.settings.calibrate.above_table else "calibrate_anywhere"
        after = f"-after-{_digest(self._colmap_name)}" if self._spares_calibrate else ""
        return f"{name}{self._sets_name}{after}"

    @property
    def _spares_calibrate(self) -> bool:
        """Whether cameras are sought in silhouettes only if COLMAP's leave something to gain."""
        return self.cameras == "auto" and not self.settings.calibrate.always

    @property
    def _colmap_name(self) -> str:
        return f"{self.model_key}-{self.settings.colmap.masks}"

    @property
    def _sets_name(self) -> str:
        """Names the sets that the photographs are divided into, if they are given."""
        sets = self.dataset.sets
        return f"-{_digest(repr(sets))}" if sets else ""

    @property
    def notes(self) -> tuple[str, ...]:
        """What its object's row says and is not used, a line each."""
        unused = describe_unused(self.cameras) if self.dataset.sets else ""
        said = [f"{self.dataset.where} (variant {self.variant!r}): {unused}"] if unused else []
        return (*self.dataset.notes, *said)

    @property
    def _silhouettes_name(self) -> str:
        if own_file(self.silhouettes):
            return f"own_{_digest(self.silhouettes)}"
        if self.network is None:
            return self.silhouettes
        return f"{self.silhouettes}_{_digest(self.network.model_dump_json())}"

    @property
    def _cameras_name(self) -> str:
        if self.cameras in ("colmap", "auto"):
            above = self.settings.calibrate.above_table
            always = "-always" if self.settings.calibrate.always else ""
            key = f"{self._colmap_name}-{above}{self._sets_name}{always}"
            return f"{self.cameras}_{_digest(key)}"
        if self.cameras == "calibrate":
            return self._calibrate_name
        if self.camera_file is None:
            return self.cameras
        return f"file_{_digest(self.cameras)}"


def _digest(name: str) -> str:
    """A short digest: 8 hexadecimal digits."""
    return f"{zlib.crc32(name.encode()):08x}"


class Plan:
    """All runs of a configuration, found again by the names in their paths.

    Args:
        values: the configuration, as read from YAML
        where: the file that it came from, for messages

    Raises:
        InputError: the configuration, the table or what it names cannot be used
    """

    def __init__(self, values: Mapping[str, Any], where: str):
        values, self.members = expand(values, where)
        self.config = parse_config(values, where)
        _refuse_lacking_curves(self.config, where)
        datasets = read_datasets(self.config.datasets)
        self.runs = [run for dataset in datasets for run in self._decide_all(dataset, where)]
        for run in self.runs:
            refuse_infeasible(run, where)
        self.afar = {address.key: address for one in datasets for address in one.afar}
        self.baseline = self._find_baseline(where)
        self.trained_on = _to_train_on(datasets, self.config, where)
        self._having = _index(self.runs)

    def _decide_all(self, dataset: Dataset, where: str) -> list[Run]:
        """The runs of an object: each member of the variants that its row names."""
        written = dict.fromkeys(member.written for member in self.members)
        for name in dataset.variants:
            if name not in written:
                raise InputError(
                    f"{dataset.where}: variants: {name!r} is not in {where}, "
                    f"which has {', '.join(written)}"
                )
        variants = self.config.variants
        return [
            _decide(dataset, member, variants[member.name], self.config, where)
            for name in dataset.variants or written
            for member in self.members
            if member.written == name
        ]

    def _find_baseline(self, where: str) -> str:
        """The experiment that others are compared with.

        Raises:
            InputError: it is not run
        """
        experiments = list(dict.fromkeys(run.member.experiment for run in self.runs))
        asked = self.config.comparison.baseline
        if asked is not None and asked not in experiments:
            raise InputError(
                f"{where}: comparison.baseline: {asked!r} is no variant that is run; there are "
                f"{', '.join(experiments)}"
            )
        return asked or experiments[0]

    def run(self, object_: str, variant: str) -> Run:
        """The run of an object with a variant."""
        return self._find(object_, "variant", variant)[0]

    def runs_of(self, object_: str) -> list[Run]:
        """The runs of an object."""
        return self._find(object_, "object", object_)

    def of_object(self, object_: str) -> Dataset:
        """The row of an object."""
        return self.runs_of(object_)[0].dataset

    def address(self, key: str) -> Address:
        """The address of an input from afar, by the name of its folder."""
        if key not in self.afar:
            raise InputError(
                f"{FOLDER / key}: no row of the table names what would be fetched there"
            )
        return self.afar[key]

    def with_key(self, object_: str, stage: str, key: str) -> Run:
        """A run of this object whose stage (``views``, ``silhouettes``, ...) has this key."""
        return self._find(object_, stage, key)[0]

    def constraints(self) -> dict[str, str]:
        """Regular expressions of the rules' wildcards: just what the runs' stages are called."""
        names = defaultdict(set)
        for run in self.runs:
            for wildcard, values in run.names.items():
                names[wildcard] |= set(values)
        found = {name: "|".join(map(re.escape, sorted(v))) or NEVER for name, v in names.items()}
        return found | {
            "object": NAME,
            "variant": NAME,
            "weights": "|".join(FOREGROUND_MODELS),
            "remote": KEY,
        }

    def variants(self, kind: str, wanted: bool) -> str:
        """A regular expression of the variants of a kind, or of all others, made by us or not.

        Args:
            kind: an attribute of the runs, ``textured`` or ``photometric``
        """
        names = {run.variant for run in self.runs if getattr(run, kind)}
        chosen = "|".join(map(re.escape, sorted(names))) or NEVER
        return chosen if wanted else f"(?!(?:{chosen})/){NAME}"

    def spares(self, object_: str, key: str) -> bool:
        """Whether no run with these silhouettes needs every one of them."""
        return all(run.policy != "keep" for run in self._find(object_, "silhouettes", key))

    def fewest_photographs(self, object_: str, key: str) -> int | None:
        """How many of the photographs of these views must be readable; None if all must."""
        runs = self._find(object_, "views", key)
        if any(run.policy == "keep" for run in runs):
            return None
        return min(run.settings.quality.fewest for run in runs)

    def _find(self, object_: str, stage: str, key: str) -> list[Run]:
        """The runs of an object whose stage has this key."""
        if found := self._having.get((object_, stage, key)):
            return found
        raise InputError(f"object {object_!r}: no variant of the configuration makes this")


def _index(runs: Sequence[Run]) -> Mapping[tuple[str, str, str], list[Run]]:
    """The runs by object, stage and key; by ``variant`` and ``object`` as well."""
    having = defaultdict(list)
    for run in runs:
        name = run.dataset.object
        having[name, "object", name].append(run)
        having[name, "variant", run.variant].append(run)
        for stage in FOLDERS:
            for key in run.keys(stage):
                having[name, stage, key].append(run)
    return dict(having)


def _to_train_on(datasets: list[Dataset], config: Config, where: str) -> list[Dataset]:
    """The objects that a network is trained on or tested on: those with masks."""
    if config.train is None:
        return []
    masked = [dataset for dataset in datasets if dataset.masks]
    if fetched := next((dataset for dataset in masked if dataset.afar), None):
        raise InputError(
            f"{fetched.where}: photographs from afar are not trained on; should be here"
        )
    names = [dataset.object for dataset in masked]
    for name in config.train.holdout:
        if name not in names:
            raise InputError(
                f"{where}: train.holdout: {name!r} is no object with masks of {config.datasets}, "
                f"which has {', '.join(names) or 'none'}"
            )
    if set(names) <= set(config.train.holdout):
        raise InputError(f"{where}: train.holdout: leaves no object with masks to train on")
    _refuse_lacking(
        f"{where}: train.weights", config.train.weights, config.train.model, promised=False
    )
    refuse_lacking_backgrounds(f"{where}: train.backgrounds", config.train.backgrounds)
    return masked


def _refuse_lacking_curves(config: Config, where: str) -> None:
    """Refuse a table of published curves that is not there, or is another."""
    if config.published is None:
        return
    if not config.published.is_file():
        raise InputError(
            f"{where}: published: {config.published}: is not there; should be a table with the "
            "columns object,variant,iteration,loss"
        )
    with blaming(f"{where}: published"):
        check_published(config.published)


def _refuse_lacking(key: str, weights: str, model: str, promised: bool) -> None:
    """Refuse weights that torchvision lacks, or a file that is not there nor made by this run."""
    if weights == NEW or (file := weights_file(weights)) is None:
        refuse_unknown_weights(key, weights, model)
        return
    if promised and file == TRAINED:
        return
    if file.is_file():
        refuse_other_weights(key, file)
        return
    raise InputError(
        f"{key}: {file}: is not there; should be a file of weights, or torchvision's name of them, "
        "as DEFAULT"
    )


def _methods_of(variant: Variant) -> dict[str, str]:
    """The methods that a variant names, each by its key: all that may be a person's own."""
    return {
        "silhouettes": variant.silhouettes or "",
        "init.shape": variant.init.shape,
        "fit.preset": variant.fit.preset,
        "fit.renderer": variant.fit.renderer,
    }


def _decide(dataset: Dataset, member: Member, variant: Variant, config: Config, where: str) -> Run:
    """An object's run with a variant: the variant's word, else the row's, else the run's."""
    name = member.name
    cameras = dataset.cameras
    if variant.cameras:
        try:
            cameras = resolve_cameras(config.datasets, variant.cameras)
        except InputError as error:
            raise InputError(f"{where}: variants.{name}.{error}") from error
    for key, method in _methods_of(variant).items():
        refuse_lacking(f"{where}: variants.{name}.{key}", method)
    refuse_lacking_mesh(f"{where}: variants.{name}.init.shape", mesh_file(variant.init.shape))
    silhouettes = variant.silhouettes or dataset.silhouettes
    _refuse_unfindable(silhouettes, dataset, name, variant, config, where)
    if cameras == "turntable" and not dataset.turntable.complete:
        raise InputError(
            f"{dataset.where}: cameras are 'turntable' (variant {name!r}), but turntable is empty, "
            "lacks a number or names several rounds; should be distance,elevation,step, for "
            "example 2.732,0,5; cameras 'calibrate' finds what is not known"
        )
    # The stage decides as well; a name says what it comes to.
    count = dataset.photographs
    colmap = variant.colmap
    matching = colmap.matching if count is None else colmap.pairing_of(count)
    policy = variant.quality.policy_for(silhouettes)
    decided = {
        "colmap": colmap.model_copy(update={"matching": matching}),
        "quality": variant.quality.model_copy(update={"policy": policy}),
    }
    settings = variant.model_copy(update=decided)
    published = variant.published or member.experiment
    return Run(dataset, member, settings, silhouettes, cameras, published)


def _refuse_unfindable(
    silhouettes: str, dataset: Dataset, name: str, variant: Variant, config: Config, where: str
) -> None:
    """Refuse a source of silhouettes that lacks its masks or its network's weights.

    Args:
        name: of the variant

    Raises:
        InputError: it is so
    """
    if silhouettes == "deeplab":
        deeplab, promised = variant.deeplab, config.train is not None
        own = f"variants.{name}." * (deeplab.weights != config.deeplab.weights)
        key = f"{own}deeplab.weights"
        _refuse_lacking(f"{where}: {key}", deeplab.weights, deeplab.model, promised)
    if silhouettes == "mask" and is_array(dataset.images[0]):
        raise InputError(
            f"{dataset.where}: silhouettes are 'mask' (variant {name!r}), but an array of images "
            "has its masks in its alpha channel; should be 'alpha'"
        )
    if silhouettes == "mask" and not dataset.masks:
        raise InputError(
            f"{dataset.where}: silhouettes are 'mask' (variant {name!r}), but masks is empty; "
            "should be a folder or a glob of mask files"
        )
    model = variant.matting.model
    if silhouettes == "matting" and model not in FOREGROUND_MODELS and not Path(model).is_file():
        raise InputError(
            f"{where}: matting.model (variant {name!r}): {model}: is not there; should be "
            f"{' or '.join(FOREGROUND_MODELS)}, or the path of an ONNX file"
        )
