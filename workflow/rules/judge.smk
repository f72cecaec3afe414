# requires  a scene
# makes     the same after its doubtful views were kept, dropped or repaired; a table and a sheet of
#           all views
# runs      silmesh.steps.judge


rule judge:
    input:
        scene=lambda w: f"results/{w.object}/stages/scenes/{with_judged(w).scene_key}",
    output:
        folder=directory("results/{object}/stages/judged/{judged}"),
        sheet=report(
            "results/report/silhouettes/{object}/{judged}.png",
            caption="../report/silhouettes.rst",
            category="Silhouettes",
            subcategory="{object}",
            labels={"silhouettes": "{judged}"},
        ),
    log:
        "logs/judge/{object}-{judged}.log",
    priority: 10
    threads: 2
    params:
        settings=judge_settings,
        code=code_digest("silmesh.steps.judge"),
    message:
        "{wildcards.object}: judging the silhouettes"
    shell:
        "python -m silmesh.steps.judge --scene {input.scene:q} {params.settings}"
        " --threads {threads} --output {output.folder:q} --sheet {output.sheet:q} 2> {log:q}"
