# requires  a scene, and its judging
# makes     of each scene a picture of its cameras, a sheet of its photographs and these for the page
# runs      silmesh.steps.gallery, silmesh.steps.rings


rule gallery:
    input:
        views=lambda w: with_judged(w).folder("views"),
        scene=lambda w: with_judged(w).folder("scene"),
        judged="results/{object}/stages/judged/{judged}",
    output:
        sheet=report(
            "results/report/silhouettes/{object}/{judged}.png",
            caption="../report/silhouettes.rst",
            category="Silhouettes",
            subcategory="{object}",
            labels={"silhouettes": "{judged}"},
        ),
        shown="results/report/galleries/{object}/{judged}.json",
    log:
        "logs/gallery/{object}-{judged}.log",
    resources:
        **resources("gallery"),
    params:
        code=code_digest("silmesh.steps.gallery"),
    message:
        "{wildcards.object}: drawing its silhouettes"
    shell:
        "python -m silmesh.steps gallery --views {input.views:q} --scene {input.scene:q}"
        " --judged {input.judged:q} --sheet {output.sheet:q} --output {output.shown:q} 2> {log:q}"


rule rings:
    input:
        scene="results/{object}/stages/scenes/{scene}",
    output:
        report(
            "results/report/cameras/{object}/{scene}.png",
            caption="../report/rings.rst",
            category="Cameras",
            subcategory="{object}",
            labels={"object": "{object}", "scene": "{scene}"},
        ),
    log:
        "logs/rings/{object}-{scene}.log",
    resources:
        **resources("rings"),
    params:
        code=code_digest("silmesh.steps.rings"),
    message:
        "{wildcards.object}: drawing the cameras of {wildcards.scene}"
    shell:
        "python -m silmesh.steps rings --scene {input.scene:q} --threads {threads}"
        " --output {output:q} 2> {log:q}"
