# What the rules share: the runs behind their wildcards, and the arguments that need choosing.

import json
import os
from functools import cache

from silmesh.files import remove, replacing
from silmesh.planning.needs import read_needs
from silmesh.planning.slurm import has_gpus, remember_jobs, try_job
from silmesh.reading import split_row
from silmesh.remote.address import fetched_folder
from silmesh.report.parts import LISTED, PARTS

REPORT_PLAN = "results/report/plan.json"
PAGES = "results/report/objects"  # of the objects, if they are many
UNFINISHED = "results/report/unfinished.html"

needs = read_needs(Path(workflow.source_path("../needs.tsv")))
object_count = len({run.dataset.object for run in plan.runs})
# Before Snakemake puts in a limit of its own.
given_gpus = workflow.global_resources.get("gpu")


def on_cluster():
    """Whether jobs have a machine of their own, and do not share this one's cores."""
    return workflow.remote_exec or workflow.non_local_exec


def all_cores(step):
    """The threads of a step that nothing runs beside on this machine."""
    return lambda _: needs[step].threads if on_cluster() else workflow.cores


def shared_cores(step):
    """The threads of a step of a run, which here has its share of the cores."""
    return lambda _: (
        needs[step].threads if on_cluster() else share_among(len(plan.runs))
    )


def object_cores(step):
    """The threads of a step of an object, which here has its share, and no more than it can use."""
    most = needs[step].threads
    return lambda _: most if on_cluster() else min(most, share_among(object_count))


def share_among(several):
    """The cores of this machine for each of so many, one at least."""
    return max(1, workflow.cores // several)


@cache
def megapixels(object_):
    """Of an object's working images, the largest that a run of it has."""
    runs = plan.runs_of(object_)
    views = len(runs[0].dataset.images)
    return views * max(run.settings.views.size for run in runs) ** 2 / 1e6


def resources(step):
    """What a scheduler is asked for a step's job, by Snakemake's names: functions of it."""
    need = needs[step]

    def extent(wildcards):
        named = getattr(wildcards, "object", None)
        return len(plan.runs) if named is None else megapixels(named)

    asked = {
        "mem_mb": lambda w, attempt: need.memory_of(extent(w), attempt),
        "runtime": lambda w, attempt: need.minutes_of(extent(w), attempt),
    }
    return asked | ({"gpu": gpus} if need.gpus else {})


def gpus(wildcards):
    """Those of a fit, where there are some and it may use them: none is no request."""
    fit = plan.run(wildcards.object, wildcards.variant).settings.fit
    return needs["fit"].gpus if fit.device != "cpu" and gpus_there() else None


@cache
def gpus_there():
    """Whether jobs may ask for a GPU: as --resources gpu=N says, else SLURM."""
    if workflow.remote_exec:  # a job has what it was given
        return "SLURM_GPUS" in os.environ
    most = given_gpus and given_gpus.value
    return on_slurm() and has_gpus() if most is None else most > 0


def let_jobs_start():
    """Lift the limit on jobs a second, if it is Snakemake's own.

    For that limit it looks at all jobs that are ready again a second after each look: with each job
    that has ended once a second more, until it does little else.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit and (limit.max_jobs, limit.timespan) == (100, 1):
        workflow.scheduler.job_rate_limiter = None


def on_slurm():
    """Whether this run gives its jobs to SLURM."""
    return workflow.executor_plugin.name == "slurm"


def try_queue():
    """Have SLURM judge the largest jobs of each account and partition, before the first is queued."""
    places = {
        "account": "slurm_account",
        "partition": "slurm_partition",
        **{key: key for key in ("qos", "constraint")},
        "gpus": "gpu",
    }
    sizes = {"cpus-per-task": "_cores", "mem": "mem_mb", "time": "runtime"}
    largest = {}
    for job in workflow.dag.needrun_jobs():
        asked = (workflow.dag.get_job_group(job) or job).resources
        where = tuple(asked.get(name) for name in places.values())
        size = tuple(asked.get(name, 0) for name in sizes.values())
        if not job.is_local:
            largest[where] = tuple(map(max, size, largest.get(where, size)))
    for where, size in largest.items():
        try_job(dict(zip(places, where)) | dict(zip(sizes, size)))


def code_digest(*modules):
    """The digest of a step's code, as a parameter that is only worked out for jobs in sight.

    A module that a step loads by its name is not found in its code: a function of the wildcards
    names it, or gives None.
    """

    def digest(wildcards):
        named = [m(wildcards) if callable(m) else m for m in modules]
        return "-".join(digest_code(name) for name in named if name)

    return digest


def network_module(wildcards):
    """The module of the network that silhouettes come from, if they do."""
    run = with_silhouettes(wildcards)
    return f"silmesh.silhouettes.{run.silhouettes}" if run.network else None


def preset_module(wildcards):
    """The module of a fit's procedure, if that is ours."""
    preset = plan.run(wildcards.object, wildcards.variant).settings.fit.preset
    return None if own_file(preset) else f"silmesh.fitting.{preset}"


def renderer_module(wildcards):
    """The module of a fit's renderer, if one of ours is named."""
    renderer = plan.run(wildcards.object, wildcards.variant).settings.fit.renderer
    ours = renderer != AUTO and not own_file(renderer)
    return f"silmesh.softras.{renderer}" if ours else None


# What a person gave is no input to Snakemake, which compares only ages: a photograph may be replaced
# by an older one, or be dated in the future. It is a parameter, with the digest of what was read.


def made(files):
    """Those of the files that the workflow makes: inputs."""
    return [as_input(file) for file in files if is_made(file)]


def as_input(file):
    """A file that is made; of what is fetched its folder, whatever its age: its name tells what it is."""
    folder = fetched_folder(file)
    return ancient(folder) if folder else file


def is_made(file):
    """Whether a file is the workflow's own and not one that a person gave."""
    if not str(file).startswith(("results/", "resources/")):  # as nearly every one
        return False
    fetched = file.parent == WEIGHTS and file.stem in FOREGROUND_MODELS
    ours = fetched or Path("results") in file.parents
    ours = ours or fetched_folder(file) is not None
    return ours or is_promised(file) or file in promised_files(file.parent)


def given_digest(files):
    """The digest of those of the files that a person gave."""
    return read_digest(file for file in files if not is_made(file))


def texts(files, input=()):
    """The paths as a rule's parameter keeps them, those of its inputs where they are read."""
    return [where(file, input) if input else str(file) for file in files]


def where(file, input):
    """Where a step reads a file: what is made may lie in a store, and is read from its copy here."""
    if not is_made(file):
        return str(file)
    whole = fetched_folder(file) or file
    last = len(whole.parts)
    copies = (str(given) for given in input if Path(given).parts[-last:] == whole.parts)
    return next(copies, str(whole)) + str(file).removeprefix(str(whole))


def fewest_photographs(wildcards):
    """The argument that says how many photographs must be readable, if not all."""
    fewest = plan.fewest_photographs(wildcards.object, wildcards.views)
    return "" if fewest is None else f"--fewest {fewest}"


def results_above(folders):
    """A function that gives where results lie, so many folders above the rule's first output.

    Where results go to a store, that is in its copy on this machine.
    """
    return lambda w, output: str(Path(output[0]).parents[folders])


def settings(section):
    """The settings of a stage as a rule's parameter, by which its step is run again: JSON.

    A text that many jobs are told is kept once.
    """
    return sys.intern(section.model_dump_json())


def with_stage(stage):
    """A function of wildcards: a run that has the stage of that name, which they name."""
    return lambda w: plan.with_key(w.object, stage, getattr(w, stage))


with_views, with_features, with_matches, with_model = map(
    with_stage, ("views", "features", "matches", "model")
)
with_scene, with_judged, with_initial = map(with_stage, ("scene", "judged", "initial"))


def judge_threads(wildcards):
    """One where nothing waits for it, so that it runs beside the initial mesh."""
    keeps = with_judged(wildcards).policy == "keep"
    return 1 if keeps else object_cores("judge")(wildcards)


def with_silhouettes(wildcards):
    """A run that has these silhouettes."""
    key = f"{wildcards.views}-{wildcards.source}"
    return plan.with_key(wildcards.object, "silhouettes", key)


def silhouettes_weights(wildcards):
    """The file of a network's weights, if the workflow makes it; a link, whatever its age."""
    file = with_silhouettes(wildcards).weights_file
    if file is None or not is_made(file):
        return []
    return ancient(file) if WEIGHTS in file.parents else file


def silhouettes_files(wildcards):
    """The files that silhouettes are read from or found by."""
    run = with_silhouettes(wildcards)
    return [*run.masks, *filter(None, [run.weights_file]), *run.silhouettes_own]


def silhouettes_settings(wildcards):
    """Those of the network, if the silhouettes come from one."""
    run = with_silhouettes(wildcards)
    own = {run.silhouettes} if run.network else set()
    return sys.intern(run.settings.model_dump_json(include=own))


def spare(wildcards):
    """The argument that lets unusable silhouettes pass, if no run needs every one."""
    key = with_silhouettes(wildcards).silhouettes_key
    return "--spare" * plan.spares(wildcards.object, key)


def with_cameras(wildcards):
    """A run that has these cameras."""
    key = f"{wildcards.views}-{wildcards.cameras}"
    return plan.with_key(wildcards.object, "cameras", key)


def camera_source(wildcards):
    """The arguments that name where cameras come from."""
    run = with_cameras(wildcards)
    if run.camera_file:
        return f"--file {quote(str(run.camera_file))}"
    table = run.turntable
    return f"--turntable {table.distance} {table.elevation} {table.step}"


def with_calibration(wildcards):
    """A run of whose attempts at cameras one is found from these silhouettes."""
    key = f"{wildcards.views}-{wildcards.source}-{wildcards.calibration}"
    return plan.with_key(wildcards.object, "cameras", key)


def known_geometry(wildcards):
    """The arguments that say what is known of a turntable whose geometry is to be found."""
    known = with_calibration(wildcards).turntable
    if known.later:
        return f"--rounds {quote(known.text)}"
    values = {
        "--elevation": known.elevation,
        "--step": known.step,
        "--distance": known.distance,
    }
    return " ".join(f"{k}={v}" for k, v in values.items() if v is not None)


def calibrate_settings(wildcards):
    """Those of the search itself: whether it is done is laid out already."""
    calibrate = with_calibration(wildcards).settings.calibrate
    return sys.intern(calibrate.model_dump_json(exclude={"always"}))


def sets_given(wildcards):
    """The argument that names the sets of photographs between which the object was turned over."""
    sets = with_calibration(wildcards).dataset.sets
    return f"--sets {quote(json.dumps(sets))}" if sets else ""


def with_colmap(wildcards):
    """A run of whose attempts at cameras one is this COLMAP's."""
    w = wildcards
    name = f"colmap_{w.masks}" if hasattr(w, "masks") else "colmap"
    key = f"{w.views}-{w.source}-{name}_{w.digest}"
    return plan.with_key(w.object, "cameras", key)


def masked_attempt(wildcards):
    """The attempt by features on the object, for one by all that is made if that leaves a gain."""
    w = wildcards
    key = f"{w.views}-{w.source}-colmap_masked_{w.digest}"
    return f"results/{w.object}/stages/cameras/{key}" if w.masks == "fallback" else []


def trial_settings(wildcards):
    """The argument that tells the fits by which an initial mesh is chosen, if it is: the report's."""
    chosen = with_initial(wildcards).settings.init.shape == "auto"
    return f"--trial {quote(settings(SoftRasFit()))}" if chosen else ""


def fitted_scene(run):
    """The scene that is fitted: before its judging where that keeps every view as it is."""
    return run.folder("scene" if run.policy == "keep" else "judged")


def initial_threads(wildcards):
    """More than one where meshes are tried by fits; carving one leaves a core to the judging."""
    chosen = with_initial(wildcards).settings.init.shape == "auto"
    return object_cores("initial")(wildcards) if chosen else 1


def fit_inputs(wildcards):
    """The stages that a fit stands on."""
    run = plan.run(wildcards.object, wildcards.variant)
    return {
        "initial": f"{run.folder('initial')}/first.ply",
        "scene": fitted_scene(run),
    }


def fit_settings(wildcards):
    """Those of a run's fit, whatever follows on it."""
    fit = plan.run(wildcards.object, wildcards.variant).settings.fit
    return sys.intern(fit.model_dump_json(exclude={"photometric"}))


def relief_inputs(wildcards, *kinds):
    """What is known of a mesh in which photographs have a say; nothing of another."""
    w, files = wildcards, {"relief": "relief.json", "standing": "standing.npy"}
    if not plan.run(w.object, w.variant).photometric:
        return {}
    return {kind: f"results/{w.object}/{w.variant}/{files[kind]}" for kind in kinds}


def relief_argument(kind):
    """The argument that names a file of ``relief_inputs``, if it is one of the inputs."""
    return lambda w, input: (
        f"--{kind} {quote(input.get(kind))}" if input.get(kind) else ""
    )


def evaluate_inputs(wildcards):
    """What a mesh is measured against."""
    run = plan.run(wildcards.object, wildcards.variant)
    truth = run.dataset.truth
    return {
        "scene": run.folder("judged"),
        "initial": f"{run.folder('initial')}/init.json",
        "truth": f"results/{wildcards.object}/stages/truth.ply" if truth else [],
        **relief_inputs(wildcards, "relief"),
        "texture": texture_notes(run),
    }


def texture_notes(run):
    """What is said of a run's texture, if it has one."""
    return (
        f"results/{run.dataset.object}/{run.variant}/texture.json"
        if run.textured
        else []
    )


def texture_argument(wildcards, input):
    """The argument that names what is said of the texture, if there is one."""
    return f"--texture {quote(input.texture)}" if input.texture else ""


def coloured_mesh(wildcards):
    """A run's mesh with colours of its vertices."""
    textured = plan.run(wildcards.object, wildcards.variant).textured
    name = "coloured.ply" if textured else "mesh.obj"
    return f"results/{wildcards.object}/{wildcards.variant}/{name}"


def textured_mesh(wildcards):
    """A run's mesh with its texture, if it has one."""
    textured = plan.run(wildcards.object, wildcards.variant).textured
    return (
        f"results/{wildcards.object}/{wildcards.variant}/mesh.glb" if textured else []
    )


def textured_argument(wildcards, input):
    """The argument that names the mesh with its texture, if there is one."""
    return f"--textured {quote(input.textured)}" if input.textured else ""


def truth_arguments(wildcards, input):
    """The arguments that name the truth, which estimated cameras are not in the frame of."""
    if not input.truth:
        return ""
    run = plan.run(wildcards.object, wildcards.variant)
    voxels = run.dataset.truth if split_row(run.dataset.truth) else None
    return (
        f"--truth {quote(input.truth)}"
        f"{f' --voxels {quote(str(voxels))}' if voxels else ''}"
        f"{' --align' if run.estimates_cameras else ''}"
    )


def training_files():
    """What a network is trained on: photographs, masks, their table, the weights that it has."""
    sets = plan.trained_on
    files = [file for one in sets for file in (*one.images, *one.masks)]
    return [*files, plan.config.datasets, Path(plan.config.train.weights)]


# Pictures are made of the first replicate of each experiment, and numbers of all.


def shown(runs):
    """Those that are shown: the first replicates."""
    return [run for run in runs if run.member.replicate == 1]


def many_shown():
    """Whether the report is an index, and a page of each object."""
    return len({run.dataset.object for run in plan.runs}) > LISTED


def experiments_of(object_):
    """The experiment that each run of an object repeats."""
    return [run.member.experiment for run in plan.runs_of(object_)]


def runs_of(object_, path):
    """A path of each run of an object."""
    return [_fill(path, run) for run in plan.runs_of(object_)]


def shown_of(object_, path):
    """A path of each run of an object that is shown."""
    return [_fill(path, run) for run in shown(plan.runs_of(object_))]


def scenes_of(object_):
    """The scene that each run of an object is fitted to, of those that are shown."""
    return [fitted_scene(run) for run in shown(plan.runs_of(object_))]


def every_run(path):
    """A path of each run, once: {0} is its object, {1} its variant, {2} its scene, {3} its judging."""
    return list(dict.fromkeys(_fill(path, run) for run in plan.runs))


def every_textured(path):
    """A path of each run with a texture, as ``every_run`` has them."""
    return list(dict.fromkeys(_fill(path, run) for run in plan.runs if run.textured))


def every_shown(path):
    """A path of each run that is shown, once."""
    return list(dict.fromkeys(_fill(path, run) for run in shown(plan.runs)))


def _fill(path, run):
    return path.format(run.dataset.object, run.variant, run.scene_key, run.judged_key)


def truths():
    """The objects that have a true mesh."""
    return list(
        dict.fromkeys(run.dataset.object for run in plan.runs if run.dataset.truth)
    )


def published():
    """The table of published curves, if there is one."""
    return [plan.config.published] if plan.config.published else []


def published_arguments(object_):
    """The arguments that name the published curves of an object's variants."""
    if not plan.config.published:
        return ""
    names = [run.published for run in shown(plan.runs_of(object_))]
    return f"--published {quote(str(plan.config.published))} --curves {' '.join(names)}"


def report_plan():
    """What the page is made of and says of its runs beside what it reads."""
    rows = {
        run.dataset.object: {
            "silhouettes": run.dataset.silhouettes,
            "cameras": run.dataset.cameras,
        }
        for run in plan.runs
    }
    return {
        "configuration": plan.config.describe(),
        "baseline": plan.baseline,
        "objects": rows,
        "truths": truths(),
        "runs": [
            {
                "object": run.dataset.object,
                "variant": run.variant,
                "experiment": run.member.experiment,
                "replicate": run.member.replicate,
                "scene": run.scene_key,
                "judged": run.judged_key,
                "published": run.published,
                "holdout": run.settings.fit.holdout,
                "stages": stages_of(run),
            }
            for run in plan.runs
        ],
    }


def stages_of(run):
    """Where Snakemake writes how long a run's stages took: none has to be there."""
    object_ = run.dataset.object
    colmap = {
        "features": f"colmap/{object_}-features-{run.features_key}",
        **logs_of_mapping(run),
    }
    files = {
        "views": f"views/{object_}-{run.views_key}",
        "silhouettes": f"silhouettes/{object_}-{run.silhouettes_key}",
        **(colmap if run.cameras in ("colmap", "auto") else {}),
        "cameras": f"cameras/{object_}-{run.cameras_keys[-1]}",
        "scene": f"scene/{object_}-{run.scene_key}",
        "judging": f"judge/{object_}-{run.judged_key}",
        "initial mesh": f"first/{object_}-{run.initial_key}",
        "fit": f"fit/{object_}-{run.variant}",
        "colours": f"{'texture' if run.textured else 'colour'}/{object_}-{run.variant}",
        "metrics": f"evaluate/{object_}-{run.variant}",
        "pictures": f"picture/{object_}-{run.variant}",
    }
    if run.photometric:
        files["photo-consistency"] = f"relief/{object_}-{run.variant}"
    return {stage: f"logs/{file}.tsv" for stage, file in files.items()}


def logs_of_mapping(run):
    """Those of matches and of a model, or of both at once where features are masked."""
    object_, masks = run.dataset.object, run.settings.colmap.masks
    if masks == "none":
        return {
            "matches": f"colmap/{object_}-matches-{run.matches_key}",
            "mapping": f"colmap/{object_}-map-{run.model_key}",
        }
    (digest,) = run.names["digest"]
    return {"mapping": f"colmap/{object_}-{run.silhouettes_key}-masked-{digest}"}


REPORT_PLAN_TEXT = json.dumps(report_plan(), indent=1) + "\n"


def write_report_plan():
    """Write what the page is told: a command line has no room for hundreds of runs."""
    with replacing(REPORT_PLAN) as part:
        part.write_text(REPORT_PLAN_TEXT, encoding="utf-8")


def show_unfinished(said):
    """Write a page of what is whole after something failed, where there are other objects."""
    if len({run.dataset.object for run in plan.runs}) > 1:
        shell(
            "python -m silmesh.steps unfinished --plan {REPORT_PLAN:q} --said {said:q}"
            " --page {UNFINISHED:q} --pages results/report/unfinished >&2 || true"
        )


def drop_unfinished():
    """Remove that page once the report is there, which is of all."""
    page, report = Path(UNFINISHED), Path("results/report/report.html")
    if (
        page.is_file()
        and report.is_file()
        and page.stat().st_mtime < report.stat().st_mtime
    ):
        remove(page)


def tell_unused():
    """Say what the table's rows found and do not use."""
    for note in dict.fromkeys(note for run in plan.runs for note in run.notes):
        print(f"silmesh: {note}", file=sys.stderr)
