# What the rules share: the runs behind their wildcards, and the arguments that need choosing.

import json

from silmesh.files import replacing
from silmesh.report.parts import PARTS

REPORT_PLAN = "results/report/plan.json"


def code_digest(module):
    """The digest of a step's code, as a parameter that is only worked out for jobs in sight."""
    return lambda wildcards: digest_code(module)


# What a person gave is no input to Snakemake, which compares only ages: a photograph may be replaced
# by an older one, or be dated in the future. It is a parameter, with the digest of what was read.


def made(files):
    """Those of the files that the workflow makes: inputs."""
    return [file for file in files if is_made(file)]


def is_made(file):
    """Whether a file is the workflow's own and not one that a person gave."""
    fetched = file.parent == WEIGHTS and file.stem in FOREGROUND_MODELS
    ours = fetched or Path("results") in file.parents
    return ours or is_promised(file) or file in promised_files(file.parent)


def given_digest(files):
    """The digest of those of the files that a person gave."""
    return read_digest(file for file in files if not is_made(file))


def texts(files):
    """The paths as a rule's parameter keeps them."""
    return [str(file) for file in files]


def photographs(wildcards, stage):
    """The photographs that a stage (``views``, ``features``) with these wildcards reads."""
    key = getattr(wildcards, stage)
    return plan.with_key(wildcards.object, stage, key).dataset.images


def views_settings(wildcards):
    """The arguments that say how photographs are resized, and how many must be readable."""
    views = plan.with_key(wildcards.object, "views", wildcards.views).views
    fewest = plan.fewest_photographs(wildcards.object, wildcards.views)
    least = "" if fewest is None else f" --fewest {fewest}"
    return f"--size {views.size} --resize {views.resize}{least}"


def with_scene(wildcards):
    """A run that has this scene."""
    return plan.with_key(wildcards.object, "scene", wildcards.scene)


def with_judged(wildcards):
    """A run that has this scene after its doubtful views were dealt with."""
    return plan.with_key(wildcards.object, "judged", wildcards.judged)


def judge_settings(wildcards):
    """The arguments that say what is done with doubtful views."""
    run = with_judged(wildcards)
    world = " --keep-world" if run.keeps_world else ""
    return f"--policy {run.policy} --fewest {run.quality.fewest}{world}"


def judge_threads(wildcards):
    """One where nothing waits for it, so that it runs beside the first mesh."""
    return 1 if with_judged(wildcards).policy == "keep" else 2


def with_first(wildcards):
    """A run that has this first mesh."""
    return plan.with_key(wildcards.object, "first", wildcards.first)


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
    return [*run.masks, *filter(None, [run.weights_file])]


def silhouettes_threads(wildcards):
    """A network's threads; another source has one."""
    return 2 if with_silhouettes(wildcards).silhouettes in ("deeplab", "matting") else 1


def silhouettes_settings(wildcards, threads):
    """The arguments that silhouettes need beside the views."""
    run = with_silhouettes(wildcards)
    spare = " --spare" * plan.spares(wildcards.object, run.silhouettes_key)
    if run.silhouettes not in ("deeplab", "matting"):
        return f"--source {run.silhouettes}{spare}"
    values = getattr(run, run.silhouettes).model_dump()
    if values.get("size") == "auto":
        values["size"] = None
    told = f"--settings {quote(json.dumps(values))} --threads {threads}"
    return f"--source {run.silhouettes} {told}{spare}"


def with_cameras(wildcards):
    """A run that has these cameras."""
    return plan.with_cameras(wildcards.object, f"{wildcards.views}-{wildcards.cameras}")


def camera_source(wildcards):
    """The arguments that name where cameras come from."""
    run = with_cameras(wildcards)
    if run.camera_file:
        return f"--file {quote(str(run.camera_file))}"
    table = run.turntable
    return f"--turntable {table.distance} {table.elevation} {table.step}"


def known_geometry(wildcards):
    """The arguments that say what is known of a turntable whose geometry is to be found."""
    key = f"{wildcards.views}-{wildcards.source}-{wildcards.calibration}"
    run = plan.with_cameras(wildcards.object, key)
    known = run.turntable
    values = {
        "--elevation": known.elevation,
        "--step": known.step,
        "--distance": known.distance,
    }
    said = [f"{k}={v}" for k, v in values.items() if v is not None]
    return " ".join(said + ["--no-above-table"] * (not run.above_table))


def with_colmap(wildcards):
    """A run of whose attempts at cameras one is this COLMAP's."""
    w = wildcards
    name = f"colmap_{w.masks}" if hasattr(w, "masks") else "colmap"
    return plan.with_cameras(w.object, f"{w.views}-{w.source}-{name}_{w.digest}")


def unmasked_attempt(wildcards):
    """The attempt without masks, for one with them that is only made if that fails."""
    w = wildcards
    key = f"{w.views}-{w.source}-colmap_{w.digest}"
    folder = f"results/{w.object}/stages/cameras/{key}"
    return {"unmasked": folder} if w.masks == "fallback" else {}


def first_settings(wildcards):
    """The arguments of a first mesh; those of the report's fit where it is chosen by one."""
    init = with_first(wildcards).init
    settings = (
        f"--shape {init.shape} --vertices {init.vertices} --align {init.align}"
        f" --genus {init.genus}"
    )
    if init.shape != "auto":
        return settings
    trial = SoftRasFit()
    return settings + (
        f" --learning-rate {trial.learning_rate} --betas {trial.betas[0]} {trial.betas[1]}"
        f" --sigma {trial.sigma} --laplacian {trial.weights.laplacian}"
        f" --flatten {trial.weights.flatten}"
    )


def fitted_scene(run):
    """The scene that is fitted: before its judging where that keeps every view as it is."""
    stages = f"results/{run.dataset.object}/stages"
    kept = run.policy == "keep"
    return f"{stages}/scenes/{run.scene_key}" if kept else judged_scene(run)


def judged_scene(run):
    """The scene with what was found of its views."""
    return f"results/{run.dataset.object}/stages/judged/{run.judged_key}"


def first_threads(wildcards):
    """Two where meshes are tried by fits; carving one leaves the other core to the judging."""
    return 2 if with_first(wildcards).init.shape == "auto" else 1


def fit_inputs(wildcards):
    """The stages that a fit stands on."""
    run = plan.run(wildcards.object, wildcards.variant)
    return {
        "first": f"results/{run.dataset.object}/stages/first/{run.first_key}/first.ply",
        "scene": fitted_scene(run),
    }


def fit_settings(wildcards):
    """The arguments of a fit."""
    fit = plan.run(wildcards.object, wildcards.variant).fit
    shared = (
        f"--preset {fit.preset} --iterations {fit.iterations} --learning-rate {fit.learning_rate}"
        f" --betas {fit.betas[0]} {fit.betas[1]} --sigma {fit.sigma}"
        f" --laplacian {fit.weights.laplacian} --flatten {fit.weights.flatten}"
        f" --holdout {fit.holdout} --device {fit.device}"
    )
    return shared if fit.preset == "softras" else f"{shared} {fast_settings(fit)}"


def fast_settings(fit):
    """The arguments that only the preset fast takes."""
    switches = (
        f"--{'' if getattr(fit, name) else 'no-'}{name.replace('_', '-')}"
        for name in ("coarse_to_fine", "refine_cameras", "remesh", "untangle")
    )
    return (
        f"--smoothing {fit.smoothing} --batch {fit.batch} --seed {fit.seed} "
        + " ".join(switches)
    )


def evaluate_inputs(wildcards):
    """What a mesh is measured against."""
    run = plan.run(wildcards.object, wildcards.variant)
    truth, stages = run.dataset.truth, fit_inputs(wildcards)
    return {
        "scene": judged_scene(run),
        "first": stages["first"].replace("first.ply", "init.json"),
        "truth": f"results/{wildcards.object}/stages/truth.ply" if truth else [],
    }


def truth_arguments(wildcards, input):
    """The arguments that name the truth, which estimated cameras are not in the frame of."""
    if not input.truth:
        return ""
    run = plan.run(wildcards.object, wildcards.variant)
    return f"--truth {quote(input.truth)}{' --align' if run.estimates_cameras else ''}"


def training_files():
    """What a network is trained on: photographs, masks, their table, the weights that it has."""
    sets = plan.trained_on
    files = [file for one in sets for file in (*one.images, *one.masks)]
    return [*files, plan.config.datasets, Path(plan.config.train.weights)]


def training_settings():
    """The arguments of a training run."""
    train = plan.config.train.model_dump()
    train["start"] = train.pop("weights")
    words = " ".join(train.pop("holdout"))
    named = " ".join(
        f"--{k.replace('_', '-')} {quote(str(v))}" for k, v in train.items()
    )
    return f"--holdout {words} {named}"


def variants_of(object_):
    """The variants that an object runs."""
    return [run.variant for run in plan.runs if run.dataset.object == object_]


def runs_of(object_, path):
    """A path of each run of an object."""
    return [_fill(path, run) for run in plan.runs if run.dataset.object == object_]


def scenes_of(object_):
    """The scene that each run of an object is fitted to."""
    return [fitted_scene(run) for run in plan.runs if run.dataset.object == object_]


def every_run(path):
    """A path of each run, once: {0} is its object, {1} its variant, {2} its scene, {3} its judging."""
    return list(dict.fromkeys(_fill(path, run) for run in plan.runs))


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
    names = [run.published for run in plan.runs if run.dataset.object == object_]
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
        "configuration": plan.config.model_dump(mode="json"),
        "objects": rows,
        "truths": truths(),
        "runs": [
            {
                "object": run.dataset.object,
                "variant": run.variant,
                "scene": run.scene_key,
                "judged": run.judged_key,
                "published": run.published,
                "holdout": run.fit.holdout,
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
        "matches": f"colmap/{object_}-matches-{run.matches_key}",
        "mapping": f"colmap/{object_}-map-{run.model_key}",
    }
    files = {
        "views": f"views/{object_}-{run.views_key}",
        "silhouettes": f"silhouettes/{object_}-{run.silhouettes_key}",
        **(colmap if run.cameras in ("colmap", "auto") else {}),
        "cameras": f"cameras/{object_}-{run.cameras_keys[-1]}",
        "scene": f"scene/{object_}-{run.scene_key}",
        "judging": f"judge/{object_}-{run.judged_key}",
        "first mesh": f"first/{object_}-{run.first_key}",
        "fit": f"fit/{object_}-{run.variant}",
        "colours": f"colour/{object_}-{run.variant}",
        "metrics": f"evaluate/{object_}-{run.variant}",
        "pictures": f"picture/{object_}-{run.variant}",
    }
    return {stage: f"logs/{file}.tsv" for stage, file in files.items()}


def write_report_plan():
    """Write what the page is told: a command line has no room for hundreds of runs."""
    with replacing(REPORT_PLAN) as part:
        part.write_text(json.dumps(report_plan(), indent=1) + "\n")


def tell_unused():
    """Say what the table's rows found and do not use."""
    datasets = {run.dataset.object: run.dataset for run in plan.runs}
    for note in [note for dataset in datasets.values() for note in dataset.notes]:
        print(f"silmesh: {note}", file=sys.stderr)
