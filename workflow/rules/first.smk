# requires  the scene
# makes     a first mesh at unit size
# runs      silmesh.steps.first


rule first:
    input:
        scene=lambda w: f"results/{w.object}/stages/judged/{with_first(w).judged_key}",
    output:
        "results/{object}/stages/first/{first}.ply",
    log:
        "logs/first/{object}-{first}.log",
    priority: 5
    params:
        settings=lambda w: "--shape {0.shape} --vertices {0.vertices} --align {0.align}".format(
            with_first(w).init
        ),
        code=code_digest("silmesh.steps.first"),
    message:
        "{wildcards.object}: making the first mesh {wildcards.first}"
    shell:
        "python -m silmesh.steps.first --scene {input.scene:q} {params.settings}"
        " --output {output:q} 2> {log:q}"
