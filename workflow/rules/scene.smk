# requires  silhouettes and cameras
# makes     cameras in the normalised world, and how well the visual hull fills the silhouettes
# runs      silmesh.steps.scene


rule scene:
    input:
        silhouettes=lambda w: f"results/{w.object}/stages/silhouettes/{with_scene(w).silhouettes_key}",
        cameras=lambda w: f"results/{w.object}/stages/cameras/{with_scene(w).cameras_key}.json",
    output:
        directory("results/{object}/stages/scenes/{scene}"),
    log:
        "logs/scene/{object}-{scene}.log",
    priority: 10
    threads: 2
    params:
        world=lambda w: "--keep-world" if with_scene(w).keeps_world else "",
        code=code_digest("silmesh.steps.scene"),
    message:
        "{wildcards.object}: carving the visual hull"
    shell:
        "python -m silmesh.steps.scene --silhouettes {input.silhouettes:q}"
        " --cameras {input.cameras:q} {params.world} --threads {threads}"
        " --output {output:q} 2> {log:q}"
