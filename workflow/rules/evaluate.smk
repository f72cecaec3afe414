# requires  a fitted mesh with its cameras and losses, the scene, perhaps the truth and a texture
# makes     its metrics
# runs      silmesh.steps.evaluate


rule evaluate:
    input:
        unpack(evaluate_inputs),
        mesh="results/{object}/{variant}/mesh.ply",
        cameras="results/{object}/{variant}/cameras.json",
        loss="results/{object}/{variant}/loss.csv",
        notes="results/{object}/{variant}/fit.json",
    output:
        "results/{object}/{variant}/metrics.json",
    log:
        "logs/evaluate/{object}-{variant}.log",
    benchmark:
        "logs/evaluate/{object}-{variant}.tsv"
    resources:
        **resources("evaluate"),
    params:
        settings=fit_settings,
        results=results_above(2),
        truth=truth_arguments,
        relief=relief_argument("relief"),
        texture=texture_argument,
        code=code_digest("silmesh.steps.evaluate"),
    message:
        "{wildcards.object}/{wildcards.variant}: evaluating"
    shell:
        "python -m silmesh.steps evaluate --mesh {input.mesh:q} --cameras {input.cameras:q}"
        " --loss {input.loss:q} --scene {input.scene:q} --initial {input.initial:q}"
        " --notes {input.notes:q} --results {params.results:q}"
        " {params.truth} {params.relief} {params.texture} --settings {params.settings:q}"
        " --threads {threads} --output {output:q} 2> {log:q}"
