# requires  an object's photographs; to judge the cameras, pixel maps and silhouettes
# makes     features, matches and a COLMAP model, then attempts at cameras: of the model, and of one
#           from features at once: those on the object, and all if that leaves something to gain
# runs      silmesh.steps.colmap_features, silmesh.steps.colmap_matches,
#           silmesh.steps.colmap_map, silmesh.steps.colmap, silmesh.steps.colmap_attempt


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


rule colmap_attempt:
    input:
        unless=masked_attempt,
        features=lambda w: with_colmap(w).folder("features"),
        views="results/{object}/stages/views/{views}",
        silhouettes="results/{object}/stages/silhouettes/{views}-{source}",
    output:
        directory(
            "results/{object}/stages/cameras/{views}-{source}-colmap_{masks}_{digest}"
        ),
    log:
        "logs/colmap/{object}-{views}-{source}-{masks}-{digest}.log",
    benchmark:
        "logs/colmap/{object}-{views}-{source}-{masks}-{digest}.tsv"
    priority: 10
    threads: object_cores("colmap_attempt")
    resources:
        **resources("colmap_attempt"),
    params:
        settings=lambda w: settings(with_colmap(w).settings.colmap),
        which=lambda w, input: "--unless" if input.unless else "--masked",
        looked_at=lambda w, input: "all" if input.unless else "the object's",
        code=code_digest("silmesh.steps.colmap_attempt"),
    message:
        "{wildcards.object}: finding cameras by {params.looked_at} features"
    shell:
        "python -m silmesh.steps colmap_attempt --features {input.features:q}"
        " --views {input.views:q} --silhouettes {input.silhouettes:q}"
        " {params.which} {input.unless:q}"
        " --settings {params.settings:q} --threads {threads} --output {output:q} 2> {log:q}"
