# requires  an initial mesh and the scene
# makes     the fitted mesh, its cameras, its losses and what it made of the views
# runs      silmesh.steps.fit; silmesh.steps.relief where photographs have a say in it


rule fit:
    input:
        unpack(fit_inputs),
    output:
        mesh="results/{object}/{variant}/mesh.ply",
        cameras="results/{object}/{variant}/cameras.json",
        loss="results/{object}/{variant}/loss.csv",
        notes="results/{object}/{variant}/fit.json",
    log:
        "logs/fit/{object}-{variant}.log",
    benchmark:
        "logs/fit/{object}-{variant}.tsv"
    wildcard_constraints:
        variant=variants_with(photometric=False),
    threads: max(1, workflow.cores // len(plan.runs))
    params:
        settings=fit_settings,
        shape=lambda w: plan.run(w.object, w.variant).settings.init.shape,
        checkpoint="results/{object}/{variant}/.checkpoint.pt",
        read=lambda w: given_digest(plan.run(w.object, w.variant).fit_own),
        code=code_digest("silmesh.steps.fit", preset_module, renderer_module),
    message:
        "{wildcards.object}/{wildcards.variant}: fitting"
    shell:
        "python -m silmesh.steps fit --initial {input.initial:q} --shape {params.shape:q}"
        " --scene {input.scene:q} --settings {params.settings:q}"
        " --threads {threads} --name {wildcards.object}/{wildcards.variant}"
        " --meshes {output.mesh:q} --cameras {output.cameras:q} --loss {output.loss:q}"
        " --notes {output.notes:q}"
        " --checkpoint {params.checkpoint:q} --code {params.code}-{params.read}"
        " 2> {log:q}"


use rule fit as fit_outlines with:
    output:
        mesh="results/{object}/{variant}/outlines.ply",
        cameras="results/{object}/{variant}/cameras.json",
        loss="results/{object}/{variant}/loss.csv",
        notes="results/{object}/{variant}/fit.json",
    wildcard_constraints:
        variant=variants_with(photometric=True),


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
        variant=variants_with(photometric=True),
    threads: max(1, workflow.cores // len(plan.runs))
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
