# requires  a scene
# makes     the same after its doubtful views were kept, dropped or repaired, with a table of all
#           views
# runs      silmesh.steps.judge


rule judge:
    input:
        scene=lambda w: f"results/{w.object}/stages/scenes/{with_judged(w).scene_key}",
    output:
        directory("results/{object}/stages/judged/{judged}"),
    log:
        "logs/judge/{object}-{judged}.log",
    benchmark:
        "logs/judge/{object}-{judged}.tsv"
    priority: 10
    threads: judge_threads
    params:
        settings=judge_settings,
        code=code_digest("silmesh.steps.judge"),
    message:
        "{wildcards.object}: judging the silhouettes"
    shell:
        "python -m silmesh.steps judge --scene {input.scene:q} {params.settings}"
        " --threads {threads} --output {output:q} 2> {log:q}"
