# What the rules share: the runs behind their wildcards, and the arguments that need choosing.

import json


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


def with_first(wildcards):
    """A run that has this first mesh."""
    return plan.with_key(wildcards.object, "first", wildcards.first)


def with_silhouettes(wildcards):
    """A run that has these silhouettes."""
    key = f"{wildcards.views}-{wildcards.source}"
    return plan.with_key(wildcards.object, "silhouettes", key)


def silhouettes_weights(wildcards):
    """The file of a network's weights; a link to fetched ones, whatever its age."""
    file = with_silhouettes(wildcards).weights_file
    return [] if file is None else ancient(file) if WEIGHTS in file.parents else file


def silhouettes_settings(wildcards, threads):
    """The arguments that silhouettes need beside the views."""
    run = with_silhouettes(wildcards)
    spare = plan.spares(wildcards.object, run.silhouettes_key)
    settings = {"matting": run.matting.model_dump() | {"threads": threads}}
    of_source = settings.get(run.silhouettes)
    told = f"--settings {quote(json.dumps(of_source))}" if of_source else ""
    return f"--source {run.silhouettes} {told}{' --spare' * spare}"


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
    key = f"{wildcards.views}-{wildcards.source}-calibrate"
    known = plan.with_cameras(wildcards.object, key).turntable
    values = {"--elevation": known.elevation, "--step": known.step}
    return " ".join(f"{k}={v}" for k, v in values.items() if v is not None)


def fit_inputs(wildcards):
    """The stages that a fit stands on."""
    run = plan.run(wildcards.object, wildcards.variant)
    stages = f"results/{wildcards.object}/stages"
    return {
        "first": f"{stages}/first/{run.first_key}.ply",
        "scene": f"{stages}/judged/{run.judged_key}",
    }


def fit_settings(wildcards):
    """The arguments of a fit."""
    fit = plan.run(wildcards.object, wildcards.variant).fit
    return (
        f"--iterations {fit.iterations} --learning-rate {fit.learning_rate}"
        f" --betas {fit.betas[0]} {fit.betas[1]} --sigma {fit.sigma}"
        f" --laplacian {fit.weights.laplacian} --flatten {fit.weights.flatten}"
        f" --holdout {fit.holdout} --device {fit.device}"
    )


def evaluate_inputs(wildcards):
    """What a mesh is measured against."""
    truth = plan.run(wildcards.object, wildcards.variant).dataset.truth
    stages = fit_inputs(wildcards)
    return {
        "scene": stages["scene"],
        "truth": f"results/{wildcards.object}/stages/truth.ply" if truth else [],
    }


def variants_of(object_):
    """The variants that an object runs."""
    return [run.variant for run in plan.runs if run.dataset.object == object_]


def report_settings():
    """What the page prints: the configuration, and what the objects' rows add to it."""
    rows = {
        run.dataset.object: {
            "silhouettes": run.dataset.silhouettes,
            "cameras": run.dataset.cameras,
        }
        for run in plan.runs
    }
    configuration = plan.config.model_dump(mode="json")
    return json.dumps({"configuration": configuration, "objects": rows})


def sheets():
    """The sheet of each set of silhouettes."""
    keys = dict.fromkeys((run.dataset.object, run.judged_key) for run in plan.runs)
    return [f"results/report/silhouettes/{object_}/{key}.png" for object_, key in keys]


def every_run(path):
    """A path of each run."""
    return [path.format(run.dataset.object, run.variant) for run in plan.runs]
