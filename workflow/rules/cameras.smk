# requires  the pixel maps of the working images, and a camera file where there is one
# makes     cameras of the working images, in the world that they come in
# runs      silmesh.steps.cameras


def camera_source(run):
    """The arguments that name where a run's cameras come from."""
    if run.camera_file:
        return f"--file '{run.camera_file}'"
    table = run.turntable
    return f"--turntable {table.distance:g} {table.elevation:g} {table.step:g}"


rule cameras:
    input:
        views="results/{object}/stages/views/{views}",
        file=lambda w: plan.with_key(
            w.object, "cameras", f"{w.views}-{w.cameras}"
        ).camera_file
        or [],
    output:
        "results/{object}/stages/cameras/{views}-{cameras}.json",
    log:
        "logs/cameras/{object}-{views}-{cameras}.log",
    priority: 10
    params:
        source=lambda w: camera_source(
            plan.with_key(w.object, "cameras", f"{w.views}-{w.cameras}")
        ),
        code=code_digest("silmesh.steps.cameras"),
    message:
        "{wildcards.object}: cameras from {wildcards.cameras}"
    shell:
        "{PYTHON:q} -m silmesh.steps.cameras --views {input.views:q} {params.source}"
        " --output {output:q} 2> {log:q}"
