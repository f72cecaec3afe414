# requires  a scene
# makes     the same after its outliers were kept, dropped or repaired, with a table of all
#           views
# runs      silmesh.steps.judge


rule judge:
    input:
        scene=lambda w: with_judged(w).folder("scene"),
    output:
        directory("results/{object}/stages/judged/{judged}"),
    log:
        "logs/judge/{object}-{judged}.log",
    benchmark:
        "logs/judge/{object}-{judged}.tsv"
    priority: 10
    threads: judge_threads
    resources:
        **resources("judge"),
    params:
        settings=lambda w: settings(with_judged(w).settings.quality),
        world=lambda w: "--keep-world" if with_judged(w).keeps_world else "",
        code=code_digest("silmesh.steps.judge"),
    message:
        "{wildcards.object}: judging the silhouettes"
    shell:
        "python -m silmesh.steps judge --scene {input.scene:q} --settings {params.settings:q}"
        " {params.world} --threads {threads} --output {output:q} 2> {log:q}"
