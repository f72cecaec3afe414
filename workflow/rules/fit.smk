# requires  a first mesh, silhouettes and the scene
# makes     the fitted mesh, its cameras and its losses
# runs      silmesh.steps.fit


def fit_inputs(wildcards):
    """The stages that a fit stands on."""
    run = plan.run(wildcards.object, wildcards.variant)
    stages = f"results/{wildcards.object}/stages"
    return {
        "first": f"{stages}/first/{run.first_key}.ply",
        "silhouettes": f"{stages}/silhouettes/{run.silhouettes_key}",
        "scene": f"{stages}/scenes/{run.scene_key}",
    }


def fit_settings(wildcards):
    """The arguments of a fit."""
    fit = plan.run(wildcards.object, wildcards.variant).fit
    return (
        f"--iterations {fit.iterations} --learning-rate {fit.learning_rate:g}"
        f" --betas {fit.betas[0]:g} {fit.betas[1]:g} --sigma {fit.sigma:g}"
        f" --laplacian {fit.weights.laplacian:g} --flatten {fit.weights.flatten:g}"
        f" --holdout {fit.holdout} --device {fit.device}"
    )


rule fit:
    input:
        unpack(fit_inputs),
    output:
        meshes=multiext("results/{object}/{variant}/mesh", ".ply", ".obj", ".glb"),
        cameras="results/{object}/{variant}/cameras.json",
        loss="results/{object}/{variant}/loss.csv",
    log:
        "logs/fit/{object}-{variant}.log",
    benchmark:
        "logs/fit/{object}-{variant}.tsv"
    threads: 2
    params:
        settings=fit_settings,
        code=code_digest("silmesh.steps.fit"),
    message:
        "{wildcards.object}/{wildcards.variant}: fitting"
    shell:
        "{PYTHON:q} -m silmesh.steps.fit --first {input.first:q}"
        " --silhouettes {input.silhouettes:q} --scene {input.scene:q} {params.settings}"
        " --threads {threads} --name {wildcards.object}/{wildcards.variant}"
        " --meshes {output.meshes:q} --cameras {output.cameras:q} --loss {output.loss:q}"
        " 2> {log:q}"
