# requires  an object's photographs
# makes     square working images and their pixel maps
# runs      silmesh.steps.views


rule views:
    input:
        lambda w: made(photographs(w, "views")),
    output:
        directory("results/{object}/stages/views/{views}"),
    log:
        "logs/views/{object}-{views}.log",
    benchmark:
        "logs/views/{object}-{views}.tsv"
    priority: 10
    params:
        images=lambda w: texts(photographs(w, "views")),
        read=lambda w: given_digest(photographs(w, "views")),
        settings=views_settings,
        code=code_digest("silmesh.steps.views"),
    message:
        "{wildcards.object}: resizing its photographs"
    shell:
        "python -m silmesh.steps views --images {params.images:q}"
        " {params.settings} --output {output:q} 2> {log:q}"
