# requires  the pixel maps of the working images, and a camera file where there is one
# makes     cameras of the working images, in the world that they come in
# runs      silmesh.steps.cameras


rule cameras:
    input:
        views="results/{object}/stages/views/{views}",
        file=lambda w: with_cameras(w).camera_file or [],
    output:
        "results/{object}/stages/cameras/{views}-{cameras}.json",
    log:
        "logs/cameras/{object}-{views}-{cameras}.log",
    priority: 10
    params:
        source=camera_source,
        code=code_digest("silmesh.steps.cameras"),
    message:
        "{wildcards.object}: cameras from {wildcards.cameras}"
    shell:
        "python -m silmesh.steps.cameras --views {input.views:q} {params.source}"
        " --output {output:q} 2> {log:q}"
