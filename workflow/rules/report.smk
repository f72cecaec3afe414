# requires  every run's losses, metrics and meshes, with its scene
# makes     a figure an object of its curves and meshes; of each run a picture, a turntable and what
#           the page shows of it; what can be concluded of the variants; two tables of all, and the page
#           with them
# runs      silmesh.steps.figure, silmesh.steps.picture, silmesh.steps.conclude, silmesh.steps.report


rule figure:
    input:
        losses=lambda w: runs_of(w.object, "results/{0}/{1}/loss.csv"),
        meshes=lambda w: shown_of(w.object, "results/{0}/{1}/mesh.ply"),
        cameras=lambda w: shown_of(w.object, "results/{0}/{1}/cameras.json"),
        scenes=lambda w: scenes_of(w.object),
        published=made(published()),
    output:
        svg=report(
            "results/report/figures/{object}.svg",
            caption="../report/figure.rst",
            category="Curves and meshes",
            labels={"object": "{object}"},
        ),
        png="results/report/figures/{object}.png",
        pdf="results/report/figures/{object}.pdf",
    log:
        "logs/figure/{object}.log",
    resources:
        **resources("figure"),
    params:
        experiments=lambda w: experiments_of(w.object),
        order=list(dict.fromkeys(run.member.experiment for run in plan.runs)),
        published=lambda w: published_arguments(w.object),
        read=lambda w: given_digest(published()),
        code=code_digest("silmesh.steps.figure"),
    message:
        "{wildcards.object}: drawing its losses and meshes"
    shell:
        "python -m silmesh.steps figure --object={wildcards.object}"
        " --losses {input.losses:q} --meshes {input.meshes:q} --cameras {input.cameras:q}"
        " --scenes {input.scenes:q} --variants {params.experiments} --order {params.order}"
        " {params.published} --outputs {output:q} 2> {log:q}"


rule picture:
    input:
        unpack(lambda w: relief_inputs(w, "standing")),
        mesh=coloured_mesh,
        textured=textured_mesh,
        cameras="results/{object}/{variant}/cameras.json",
        initial=lambda w: fit_inputs(w)["initial"],
        scene=lambda w: fit_inputs(w)["scene"],
    output:
        picture=report(
            "results/report/pictures/{object}/{variant}.png",
            caption="../report/picture.rst",
            category="Meshes",
            subcategory="{object}",
            labels={"object": "{object}", "variant": "{variant}", "kind": "picture"},
        ),
        gif=report(
            "results/report/turntables/{object}/{variant}.gif",
            caption="../report/turntable.rst",
            category="Meshes",
            subcategory="{object}",
            labels={
                "object": "{object}",
                "variant": "{variant}",
                "kind": "turntable",
            },
        ),
        mp4="results/report/turntables/{object}/{variant}.mp4",
        exhibit="results/report/exhibits/{object}/{variant}.json",
    log:
        "logs/picture/{object}-{variant}.log",
    benchmark:
        "logs/picture/{object}-{variant}.tsv"
    resources:
        **resources("picture"),
    params:
        settings=fit_settings,
        standing=relief_argument("standing"),
        textured=textured_argument,
        code=code_digest("silmesh.steps.picture"),
    message:
        "{wildcards.object}/{wildcards.variant}: drawing the mesh beside its photographs"
    shell:
        "python -m silmesh.steps picture --mesh {input.mesh:q} {params.textured}"
        " --initial {input.initial:q}"
        " --cameras {input.cameras:q} --scene {input.scene:q}"
        " --settings {params.settings:q} {params.standing}"
        " --output {output.picture:q} --gif {output.gif:q} --mp4 {output.mp4:q}"
        " --exhibit {output.exhibit:q} 2> {log:q}"


rule conclude:
    input:
        losses=every_run("results/{0}/{1}/loss.csv"),
        metrics=every_run("results/{0}/{1}/metrics.json"),
    output:
        table=report(
            "results/report/comparison.csv",
            caption="../report/comparison.rst",
            category="Tables",
            labels={"table": "comparison"},
        ),
        latex="results/report/comparison.tex",
        svg="results/report/comparison.svg",
        pdf="results/report/comparison.pdf",
    log:
        "logs/conclude.log",
    resources:
        **resources("conclude"),
    params:
        told=text_digest(REPORT_PLAN_TEXT),
        plan=REPORT_PLAN,
        results=results_above(1),
        code=code_digest("silmesh.steps.conclude"),
    message:
        "comparing the variants"
    shell:
        "python -m silmesh.steps conclude --plan {params.plan:q} --results {params.results:q} --table {output.table:q}"
        " --latex {output.latex:q} --figures {output.svg:q} {output.pdf:q} 2> {log:q}"


rule page:
    input:
        conclusions="results/report/comparison.csv",
        losses=every_run("results/{0}/{1}/loss.csv"),
        metrics=every_run("results/{0}/{1}/metrics.json"),
        pictures=every_shown("results/report/pictures/{0}/{1}.png"),
        exhibits=every_shown("results/report/exhibits/{0}/{1}.json"),
        figures=every_shown("results/report/figures/{0}.svg"),
        scenes=every_run("results/{0}/stages/scenes/{2}"),
        judged=every_run("results/{0}/stages/judged/{3}"),
        rings=every_run("results/report/cameras/{0}/{2}.png"),
        sheets=every_run("results/report/silhouettes/{0}/{3}.png"),
        galleries=every_run("results/report/galleries/{0}/{3}.json"),
        truths=[f"results/{object_}/stages/truth.ply" for object_ in truths()],
        published=made(published()),
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
        pages=[directory(PAGES)] if many_shown() else [],
    log:
        "logs/report.log",
    resources:
        **resources("report"),
    params:
        told=text_digest(REPORT_PLAN_TEXT),
        plan=REPORT_PLAN,
        pages=lambda w, output: str(Path(output.page).with_name("objects")),
        results=results_above(1),
        read=given_digest(published()),
        code=code_digest("silmesh.steps.report"),
        parts=[file_digest("silmesh.report", name) for name in PARTS],
    message:
        "writing results/report/report.html"
    shell:
        "python -m silmesh.steps report --plan {params.plan:q} --results {params.results:q}"
        " --losses {output.losses:q} --conclusions {input.conclusions:q}"
        " --summary {output.summary:q} --page {output.page:q} --pages {params.pages:q} 2> {log:q}"
