# requires  an object's photographs; to judge the cameras, pixel maps and silhouettes
# makes     features, matches and a COLMAP model, then attempts at cameras: of the model, and of one
#           from the features on the object alone
# runs      silmesh.steps.colmap_features, silmesh.steps.colmap_matches,
#           silmesh.steps.colmap_map, silmesh.steps.colmap, silmesh.steps.colmap_masked


rule colmap_features:
    input:
        lambda w: made(with_features(w).dataset.images),
    output:
        directory("results/{object}/stages/features/{features}"),
    log:
        "logs/colmap/{object}-features-{features}.log",
    benchmark:
        "logs/colmap/{object}-features-{features}.tsv"
    priority: 10
    threads: all_cores("colmap_features")
    resources:
        **resources("colmap_features"),
    params:
        images=lambda w, input: texts(with_features(w).dataset.images, input),
        read=lambda w: given_digest(with_features(w).dataset.images),
        settings=lambda w: settings(with_features(w).settings.colmap.part(Features)),
        code=code_digest("silmesh.steps.colmap_features"),
    message:
        "{wildcards.object}: finding the features of its photographs"
    shell:
        "python -m silmesh.steps colmap_features --images {params.images:q}"
        " --settings {params.settings:q} --threads {threads} --output {output:q} 2> {log:q}"


rule colmap_matches:
    input:
        lambda w: with_matches(w).folder("features"),
    output:
        directory("results/{object}/stages/matches/{matches}"),
    log:
        "logs/colmap/{object}-matches-{matches}.log",
    benchmark:
        "logs/colmap/{object}-matches-{matches}.tsv"
    priority: 10
    threads: all_cores("colmap_matches")
    resources:
        **resources("colmap_matches"),
    params:
        settings=lambda w: settings(with_matches(w).settings.colmap.part(Matches)),
        code=code_digest("silmesh.steps.colmap_matches"),
    message:
        "{wildcards.object}: matching its photographs"
    shell:
        "python -m silmesh.steps colmap_matches --features {input:q}"
        " --settings {params.settings:q} --threads {threads}"
        " --output {output:q} 2> {log:q}"


rule colmap_map:
    input:
        lambda w: with_model(w).folder("matches"),
    output:
        directory("results/{object}/stages/models/{model}"),
    log:
        "logs/colmap/{object}-map-{model}.log",
    benchmark:
        "logs/colmap/{object}-map-{model}.tsv"
    priority: 10
    resources:
        **resources("colmap_map"),
    params:
        settings=lambda w: settings(with_model(w).settings.colmap.part(Reconstruction)),
        code=code_digest("silmesh.steps.colmap_map"),
    message:
        "{wildcards.object}: finding cameras from its matches"
    shell:
        "python -m silmesh.steps colmap_map --matches {input:q}"
        " --settings {params.settings:q} --output {output:q} 2> {log:q}"


rule colmap:
    input:
        model=lambda w: with_colmap(w).folder("model"),
        views="results/{object}/stages/views/{views}",
        silhouettes="results/{object}/stages/silhouettes/{views}-{source}",
    output:
        directory("results/{object}/stages/cameras/{views}-{source}-colmap_{digest}"),
    log:
        "logs/colmap/{object}-{views}-{source}-{digest}.log",
    priority: 10
    threads: object_cores("colmap")
    resources:
        **resources("colmap"),
    params:
        code=code_digest("silmesh.steps.colmap"),
    message:
        "{wildcards.object}: judging the cameras by the silhouettes"
    shell:
        "python -m silmesh.steps colmap --model {input.model:q} --views {input.views:q}"
        " --silhouettes {input.silhouettes:q} --threads {threads} --output {output:q} 2> {log:q}"


rule colmap_masked:
    input:
        unpack(unmasked_attempt),
        features=lambda w: with_colmap(w).folder("features"),
        views="results/{object}/stages/views/{views}",
        silhouettes="results/{object}/stages/silhouettes/{views}-{source}",
    output:
        directory(
            "results/{object}/stages/cameras/{views}-{source}-colmap_{masks}_{digest}"
        ),
    log:
        "logs/colmap/{object}-{views}-{source}-{masks}-{digest}.log",
    priority: 10
    threads: object_cores("colmap_masked")
    resources:
        **resources("colmap_masked"),
    params:
        settings=lambda w: settings(with_colmap(w).settings.colmap),
        unmasked=lambda w, input: (
            f"--unmasked {quote(input.unmasked)}" if input.get("unmasked") else ""
        ),
        code=code_digest("silmesh.steps.colmap_masked"),
    message:
        "{wildcards.object}: finding cameras by the features on the object"
    shell:
        "python -m silmesh.steps colmap_masked --features {input.features:q}"
        " --views {input.views:q} --silhouettes {input.silhouettes:q} {params.unmasked}"
        " --settings {params.settings:q} --threads {threads} --output {output:q} 2> {log:q}"
