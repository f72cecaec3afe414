# requires  an object's photographs; to judge the cameras, pixel maps and silhouettes
# makes     features, matches and a COLMAP model, then attempts at cameras: of the model, and of one
#           from the features on the object alone
# runs      silmesh.steps.colmap_features, silmesh.steps.colmap_matches,
#           silmesh.steps.colmap_map, silmesh.steps.colmap, silmesh.steps.colmap_masked


rule colmap_features:
    input:
        lambda w: made(photographs(w, "features")),
    output:
        directory("results/{object}/stages/features/{features}"),
    log:
        "logs/colmap/{object}-features-{features}.log",
    benchmark:
        "logs/colmap/{object}-features-{features}.tsv"
    priority: 10
    threads: workflow.cores
    params:
        images=lambda w: texts(photographs(w, "features")),
        read=lambda w: given_digest(photographs(w, "features")),
        settings=lambda w: "--max-size {0.max_size} --features {0.features}".format(
            plan.with_key(w.object, "features", w.features).colmap
        ),
        code=code_digest("silmesh.steps.colmap_features"),
    message:
        "{wildcards.object}: finding the features of its photographs"
    shell:
        "python -m silmesh.steps colmap_features --images {params.images:q} {params.settings}"
        " --threads {threads} --output {output:q} 2> {log:q}"


rule colmap_matches:
    input:
        "results/{object}/stages/features/{features}",
    output:
        directory("results/{object}/stages/matches/{features}-{matching}-{seed}"),
    log:
        "logs/colmap/{object}-matches-{features}-{matching}-{seed}.log",
    benchmark:
        "logs/colmap/{object}-matches-{features}-{matching}-{seed}.tsv"
    priority: 10
    threads: workflow.cores
    params:
        code=code_digest("silmesh.steps.colmap_matches"),
    message:
        "{wildcards.object}: matching its photographs"
    shell:
        "python -m silmesh.steps colmap_matches --features {input:q}"
        " --matching {wildcards.matching} --seed {wildcards.seed} --threads {threads}"
        " --output {output:q} 2> {log:q}"


rule colmap_map:
    input:
        "results/{object}/stages/matches/{matches}",
    output:
        directory("results/{object}/stages/models/{matches}-{mapping}"),
    log:
        "logs/colmap/{object}-map-{matches}-{mapping}.log",
    benchmark:
        "logs/colmap/{object}-map-{matches}-{mapping}.tsv"
    priority: 10
    params:
        seed=lambda w: plan.with_key(w.object, "matches", w.matches).colmap.seed,
        code=code_digest("silmesh.steps.colmap_map"),
    message:
        "{wildcards.object}: finding cameras from its matches"
    shell:
        "python -m silmesh.steps colmap_map --matches {input:q} --mapping {wildcards.mapping}"
        " --seed {params.seed} --output {output:q} 2> {log:q}"


rule colmap:
    input:
        model=lambda w: f"results/{w.object}/stages/models/{with_colmap(w).model_key}",
        views="results/{object}/stages/views/{views}",
        silhouettes="results/{object}/stages/silhouettes/{views}-{source}",
    output:
        directory("results/{object}/stages/cameras/{views}-{source}-colmap_{digest}"),
    log:
        "logs/colmap/{object}-{views}-{source}-{digest}.log",
    priority: 10
    threads: 2
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
        features=lambda w: f"results/{w.object}/stages/features/{with_colmap(w).features_key}",
        views="results/{object}/stages/views/{views}",
        silhouettes="results/{object}/stages/silhouettes/{views}-{source}",
    output:
        directory(
            "results/{object}/stages/cameras/{views}-{source}-colmap_{masks}_{digest}"
        ),
    log:
        "logs/colmap/{object}-{views}-{source}-{masks}-{digest}.log",
    priority: 10
    threads: 2
    params:
        settings=lambda w: "--matching {0.matching} --mapping {0.colmap.mapping} --seed {0.colmap.seed}".format(
            with_colmap(w)
        ),
        unmasked=lambda w, input: (
            f"--unmasked {quote(input.unmasked)}" if input.get("unmasked") else ""
        ),
        code=code_digest("silmesh.steps.colmap_masked"),
    message:
        "{wildcards.object}: finding cameras by the features on the object"
    shell:
        "python -m silmesh.steps colmap_masked --features {input.features:q}"
        " --views {input.views:q} --silhouettes {input.silhouettes:q} {params.unmasked}"
        " {params.settings} --threads {threads} --output {output:q} 2> {log:q}"
