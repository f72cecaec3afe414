# requires  the scene
# makes     a first mesh at unit size, and what is to be said of it
# runs      silmesh.steps.first


rule first:
    input:
        scene=lambda w: fitted_scene(with_first(w)),
    output:
        mesh="results/{object}/stages/first/{first}/first.ply",
        report="results/{object}/stages/first/{first}/init.json",
    log:
        "logs/first/{object}-{first}.log",
    benchmark:
        "logs/first/{object}-{first}.tsv"
    priority: 5
    threads: first_threads
    params:
        settings=lambda w: settings(with_first(w).settings.init),
        trial=trial_settings,
        read=lambda w: given_digest(filter(None, [with_first(w).init_file])),
        code=code_digest("silmesh.steps.first"),
    message:
        "{wildcards.object}: making the first mesh {wildcards.first}"
    shell:
        "python -m silmesh.steps first --scene {input.scene:q} --settings {params.settings:q}"
        " {params.trial} --threads {threads} --output {output.mesh:q} --report {output.report:q} 2> {log:q}"
