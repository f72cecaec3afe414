# requires  working images, and mask files where silhouettes come from them
# makes     a silhouette for every view
# runs      silmesh.steps.silhouettes


rule silhouettes:
    input:
        views="results/{object}/stages/views/{views}",
        masks=lambda w: plan.with_key(
            w.object, "silhouettes", f"{w.views}-{w.source}"
        ).masks,
    output:
        directory("results/{object}/stages/silhouettes/{views}-{source}"),
    log:
        "logs/silhouettes/{object}-{views}-{source}.log",
    priority: 10
    params:
        code=code_digest("silmesh.steps.silhouettes"),
    message:
        "{wildcards.object}: finding silhouettes by {wildcards.source}"
    shell:
        "python -m silmesh.steps.silhouettes --views {input.views:q}"
        " --source {wildcards.source} --masks {input.masks:q} --output {output:q} 2> {log:q}"
