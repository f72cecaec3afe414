# requires  every run's losses, metrics and mesh, with its scene
# makes     a loss figure an object, a picture a run, one of each scene's cameras, two tables of all,
#           and the page with them
# runs      silmesh.steps.figure, silmesh.steps.picture, silmesh.steps.rings, silmesh.steps.report


rule figure:
    input:
        losses=lambda w: [
            f"results/{w.object}/{variant}/loss.csv"
            for variant in variants_of(w.object)
        ],
    output:
        svg=report(
            "results/report/figures/{object}.svg",
            caption="../report/loss.rst",
            category="Losses",
            labels={"object": "{object}"},
        ),
        png="results/report/figures/{object}.png",
    log:
        "logs/figure/{object}.log",
    params:
        variants=lambda w: variants_of(w.object),
        order=list(plan.config.variants),
        code=code_digest("silmesh.steps.figure"),
    message:
        "{wildcards.object}: drawing its losses"
    shell:
        "python -m silmesh.steps.figure --object={wildcards.object}"
        " --losses {input.losses:q} --variants {params.variants} --order {params.order}"
        " --outputs {output:q} 2> {log:q}"


rule picture:
    input:
        mesh="results/{object}/{variant}/mesh.obj",
        cameras="results/{object}/{variant}/cameras.json",
        scene=lambda w: fit_inputs(w)["scene"],
    output:
        report(
            "results/report/pictures/{object}/{variant}.png",
            caption="../report/picture.rst",
            category="Meshes",
            subcategory="{object}",
            labels={"object": "{object}", "variant": "{variant}"},
        ),
    log:
        "logs/picture/{object}-{variant}.log",
    params:
        code=code_digest("silmesh.steps.picture"),
    message:
        "{wildcards.object}/{wildcards.variant}: drawing the mesh beside its photographs"
    shell:
        "python -m silmesh.steps.picture --mesh {input.mesh:q} --cameras {input.cameras:q}"
        " --scene {input.scene:q} --output {output:q} 2> {log:q}"


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
    params:
        code=code_digest("silmesh.steps.rings"),
    message:
        "{wildcards.object}: drawing the cameras of {wildcards.scene}"
    shell:
        "python -m silmesh.steps.rings --scene {input.scene:q} --threads {threads}"
        " --output {output:q} 2> {log:q}"


rule page:
    input:
        losses=every_run("results/{}/{}/loss.csv"),
        metrics=every_run("results/{}/{}/metrics.json"),
        pictures=every_run("results/report/pictures/{}/{}.png"),
        figures=list(dict.fromkeys(every_run("results/report/figures/{}.svg"))),
        scenes=list(dict.fromkeys(every_run("results/{0}/stages/scenes/{2}"))),
        rings=list(dict.fromkeys(every_run("results/report/cameras/{0}/{2}.png"))),
        sheets=sheets(),
    output:
        losses=report(
            "results/report/losses.csv",
            caption="../report/losses.rst",
            category="Tables",
            labels={"table": "losses"},
        ),
        summary=report(
            "results/report/summary.csv",
            caption="../report/summary.rst",
            category="Tables",
            labels={"table": "summary"},
        ),
        page=report(
            "results/report/report.html",
            caption="../report/page.rst",
            category="Page",
            labels={"page": "report"},
        ),
    log:
        "logs/report.log",
    params:
        runs=every_run("{}/{}/{}"),
        settings=report_settings(),
        code=code_digest("silmesh.steps.report"),
        template=file_digest("silmesh.report", "page.html.j2"),
    message:
        "writing results/report/report.html"
    shell:
        "python -m silmesh.steps.report --results results --runs {params.runs}"
        " --settings {params.settings:q} --sheets {input.sheets:q} --losses {output.losses:q}"
        " --summary {output.summary:q} --page {output.page:q} 2> {log:q}"
