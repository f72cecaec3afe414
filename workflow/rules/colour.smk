# requires  a fitted mesh with its cameras, and the scene
# makes     the mesh with colours of its vertices from the photographs, for variants without texture
# runs      silmesh.steps.colour


rule colour:
    input:
        mesh="results/{object}/{variant}/mesh.ply",
        cameras="results/{object}/{variant}/cameras.json",
        scene=lambda w: fit_inputs(w)["scene"],
    output:
        multiext("results/{object}/{variant}/mesh", ".obj", ".glb"),
    log:
        "logs/colour/{object}-{variant}.log",
    benchmark:
        "logs/colour/{object}-{variant}.tsv"
    wildcard_constraints:
        variant=plan.variants("textured", False),
    resources:
        **resources("colour"),
    params:
        code=code_digest("silmesh.steps.colour"),
    message:
        "{wildcards.object}/{wildcards.variant}: colouring the mesh"
    shell:
        "python -m silmesh.steps colour --mesh {input.mesh:q} --cameras {input.cameras:q}"
        " --scene {input.scene:q} --meshes {output:q} 2> {log:q}"
