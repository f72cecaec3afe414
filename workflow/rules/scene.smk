# requires  working images, silhouettes, and attempts at cameras
# makes     the views that are fitted, their silhouettes, and the most coherent cameras, normalised
# runs      silmesh.steps.scene


rule scene:
    input:
        views=lambda w: with_scene(w).folder("views"),
        silhouettes=lambda w: with_scene(w).folder("silhouettes"),
        cameras=lambda w: with_scene(w).folders("cameras"),
    output:
        directory("results/{object}/stages/scenes/{scene}"),
    log:
        "logs/scene/{object}-{scene}.log",
    benchmark:
        "logs/scene/{object}-{scene}.tsv"
    priority: 10
    threads: object_cores("scene")
    resources:
        **resources("scene"),
    params:
        world=lambda w: "--keep-world" if with_scene(w).keeps_world else "",
        code=code_digest("silmesh.steps.scene"),
    message:
        "{wildcards.object}: carving the visual hull"
    shell:
        "python -m silmesh.steps scene --views {input.views:q} --silhouettes {input.silhouettes:q}"
        " --cameras {input.cameras:q} {params.world} --threads {threads}"
        " --output {output:q} 2> {log:q}"
