# requires  an initial mesh and the scene
# makes     the fitted mesh, its cameras, its losses and what it made of the views
# runs      silmesh.steps.fit


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
        variant=plan.variants("photometric", False),
    threads: shared_cores("fit")
    resources:
        **resources("fit"),
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
        variant=plan.variants("photometric", True),
