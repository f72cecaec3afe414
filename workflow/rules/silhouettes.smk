# requires  working images, and mask files or weights where silhouettes come from them
# makes     a silhouette for every view
# runs      silmesh.steps.silhouettes


rule silhouettes:
    input:
        views="results/{object}/stages/views/{views}",
        masks=lambda w: with_silhouettes(w).masks,
        weights=lambda w: with_silhouettes(w).weights_file or [],
    output:
        directory("results/{object}/stages/silhouettes/{views}-{source}"),
    log:
        "logs/silhouettes/{object}-{views}-{source}.log",
    priority: 10
    threads: lambda w: 2 if with_silhouettes(w).silhouettes == "deeplab" else 1
    params:
        source=lambda w: with_silhouettes(w).silhouettes,
        settings=silhouettes_settings,
        code=code_digest("silmesh.steps.silhouettes"),
    message:
        "{wildcards.object}: finding silhouettes by {wildcards.source}"
    shell:
        "python -m silmesh.steps.silhouettes --views {input.views:q}"
        " --source {params.source} --masks {input.masks:q} {params.settings}"
        " --output {output:q} 2> {log:q}"
