# requires  an object's photographs
# makes     square working images and their pixel maps
# runs      silmesh.steps.views


rule views:
    input:
        lambda w: made(with_views(w).dataset.images),
    output:
        directory("results/{object}/stages/views/{views}"),
    log:
        "logs/views/{object}-{views}.log",
    benchmark:
        "logs/views/{object}-{views}.tsv"
    priority: 10
    threads: object_cores("views")
    resources:
        **resources("views"),
    params:
        images=lambda w, input: texts(with_views(w).dataset.images, input),
        read=lambda w: given_digest(with_views(w).dataset.images),
        settings=lambda w: settings(with_views(w).settings.views),
        fewest=fewest_photographs,
        code=code_digest("silmesh.steps.views"),
    message:
        "{wildcards.object}: resizing its photographs"
    shell:
        "python -m silmesh.steps views --images {params.images:q}"
        " --settings {params.settings:q} {params.fewest} --threads {threads}"
        " --output {output:q} 2> {log:q}"
