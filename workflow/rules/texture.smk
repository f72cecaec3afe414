# requires  a fitted mesh with its cameras, the scene, the views and the photographs behind them
# makes     the mesh with a texture, OBJ and GLB, and with colours of its vertices, for variants that
#           want one, and how well it shows the photographs that were held out
# runs      silmesh.steps.texture


rule texture:
    input:
        lambda w: made(plan.run(w.object, w.variant).dataset.images),
        mesh="results/{object}/{variant}/mesh.ply",
        cameras="results/{object}/{variant}/cameras.json",
        scene=lambda w: fit_inputs(w)["scene"],
        views=lambda w: plan.run(w.object, w.variant).folder("views"),
    output:
        obj="results/{object}/{variant}/mesh.obj",
        material="results/{object}/{variant}/mesh.mtl",
        image="results/{object}/{variant}/mesh.png",
        glb="results/{object}/{variant}/mesh.glb",
        coloured="results/{object}/{variant}/coloured.ply",
        notes="results/{object}/{variant}/texture.json",
    log:
        "logs/texture/{object}-{variant}.log",
    benchmark:
        "logs/texture/{object}-{variant}.tsv"
    wildcard_constraints:
        variant=plan.variants("textured", True),
    threads: shared_cores("texture")
    resources:
        **resources("texture"),
    params:
        settings=lambda w: settings(plan.run(w.object, w.variant).settings.texture),
        holdout=lambda w: plan.run(w.object, w.variant).settings.fit.holdout,
        read=lambda w: given_digest(plan.run(w.object, w.variant).dataset.images),
        code=code_digest("silmesh.steps.texture"),
    message:
        "{wildcards.object}/{wildcards.variant}: making its texture"
    shell:
        "python -m silmesh.steps texture --mesh {input.mesh:q} --cameras {input.cameras:q}"
        " --scene {input.scene:q} --views {input.views:q} --settings {params.settings:q}"
        " --holdout {params.holdout} --threads {threads}"
        " --name {wildcards.object}/{wildcards.variant}"
        " --output {output.obj:q} --material {output.material:q} --image {output.image:q}"
        " --glb {output.glb:q} --coloured {output.coloured:q} --notes {output.notes:q} 2> {log:q}"
