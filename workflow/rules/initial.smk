# requires  the scene
# makes     an initial mesh at unit size, and what is to be said of it
# runs      silmesh.steps.initial


rule initial:
    input:
        scene=lambda w: fitted_scene(with_initial(w)),
    output:
        mesh="results/{object}/stages/first/{initial}/first.ply",
        report="results/{object}/stages/first/{initial}/init.json",
    log:
        "logs/first/{object}-{initial}.log",
    benchmark:
        "logs/first/{object}-{initial}.tsv"
    priority: 5
    threads: initial_threads
    resources:
        **resources("initial"),
    params:
        settings=lambda w: settings(with_initial(w).settings.init),
        trial=trial_settings,
        read=lambda w: given_digest(with_initial(w).initial_own),
        code=code_digest("silmesh.steps.initial"),
    message:
        "{wildcards.object}: making the initial mesh {wildcards.initial}"
    shell:
        "python -m silmesh.steps initial --scene {input.scene:q} --settings {params.settings:q}"
        " {params.trial} --threads {threads} --output {output.mesh:q} --report {output.report:q} 2> {log:q}"
