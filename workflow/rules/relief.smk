# requires  a fitted mesh with its cameras, the scene, and the photographs
# makes     the mesh moved to where the photographs agree, or the same; what each vertex stands on
# runs      silmesh.steps.relief


rule relief:
    input:
        images=lambda w: made(plan.of_object(w.object).images),
        views=lambda w: plan.run(w.object, w.variant).folder("views"),
        scene=lambda w: fit_inputs(w)["scene"],
        mesh="results/{object}/{variant}/outlines.ply",
        cameras="results/{object}/{variant}/cameras.json",
        notes="results/{object}/{variant}/fit.json",
    output:
        mesh="results/{object}/{variant}/mesh.ply",
        standing="results/{object}/{variant}/standing.npy",
        notes="results/{object}/{variant}/relief.json",
    log:
        "logs/relief/{object}-{variant}.log",
    benchmark:
        "logs/relief/{object}-{variant}.tsv"
    wildcard_constraints:
        variant=plan.variants("photometric", True),
    threads: shared_cores("relief")
    resources:
        **resources("relief"),
    params:
        settings=fit_settings,
        read=lambda w: given_digest(plan.of_object(w.object).images),
        code=code_digest("silmesh.steps.relief"),
    message:
        "{wildcards.object}/{wildcards.variant}: looking for what outlines cannot show"
    shell:
        "python -m silmesh.steps relief --mesh {input.mesh:q} --cameras {input.cameras:q}"
        " --scene {input.scene:q} --views {input.views:q} --fit {input.notes:q}"
        " --settings {params.settings:q} --threads {threads}"
        " --name {wildcards.object}/{wildcards.variant} --output {output.mesh:q}"
        " --standing {output.standing:q} --notes {output.notes:q} 2> {log:q}"
