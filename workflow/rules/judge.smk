# requires  a scene
# makes     the same after its doubtful views were kept, dropped or repaired, with a table of all
#           views; for the report a sheet of these
# runs      silmesh.steps.judge, silmesh.steps.sheet


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


rule sheet:
    input:
        scene=lambda w: f"results/{w.object}/stages/scenes/{with_judged(w).scene_key}",
        judged="results/{object}/stages/judged/{judged}",
    output:
        report(
            "results/report/silhouettes/{object}/{judged}.png",
            caption="../report/silhouettes.rst",
            category="Silhouettes",
            subcategory="{object}",
            labels={"silhouettes": "{judged}"},
        ),
    log:
        "logs/sheet/{object}-{judged}.log",
    params:
        code=code_digest("silmesh.steps.sheet"),
    message:
        "{wildcards.object}: drawing its silhouettes"
    shell:
        "python -m silmesh.steps sheet --scene {input.scene:q} --judged {input.judged:q}"
        " --output {output:q} 2> {log:q}"
