# requires  the pixel maps of the working images, and camera files where there are any
# makes     cameras of the working images, in the world that they come in
# runs      silmesh.steps.cameras


rule cameras:
    input:
        views="results/{object}/stages/views/{views}",
        files=lambda w: made(with_cameras(w).camera_files),
    output:
        directory("results/{object}/stages/cameras/{views}-{cameras}"),
    log:
        "logs/cameras/{object}-{views}-{cameras}.log",
    benchmark:
        "logs/cameras/{object}-{views}-{cameras}.tsv"
    priority: 10
    resources:
        **resources("cameras"),
    params:
        files=lambda w: texts(with_cameras(w).camera_files),
        read=lambda w: given_digest(with_cameras(w).camera_files),
        source=camera_source,
        code=code_digest("silmesh.steps.cameras"),
    message:
        "{wildcards.object}: cameras from {wildcards.cameras}"
    shell:
        "python -m silmesh.steps cameras --views {input.views:q} {params.source}"
        " --output {output:q} 2> {log:q}"


# requires  silhouettes of a turntable whose geometry is not known
# makes     an attempt at its cameras, and how far to trust them
# runs      silmesh.steps.calibrate


rule calibrate:
    input:
        unless=lambda w: with_calibration(w).sparing,
        views="results/{object}/stages/views/{views}",
        silhouettes="results/{object}/stages/silhouettes/{views}-{source}",
    output:
        directory("results/{object}/stages/cameras/{views}-{source}-{calibration}"),
    log:
        "logs/cameras/{object}-{views}-{source}-{calibration}.log",
    benchmark:
        "logs/cameras/{object}-{views}-{source}-{calibration}.tsv"
    priority: 10
    threads: object_cores("calibrate")
    resources:
        **resources("calibrate"),
    params:
        known=known_geometry,
        sets=sets_given,
        unless=lambda w, input: "--unless" if input.unless else "",
        settings=calibrate_settings,
        code=code_digest("silmesh.steps.calibrate"),
    message:
        "{wildcards.object}: finding cameras from silhouettes by {wildcards.source}"
    shell:
        "python -m silmesh.steps calibrate --views {input.views:q}"
        " --silhouettes {input.silhouettes:q} {params.known} {params.sets}"
        " {params.unless} {input.unless:q} --settings {params.settings:q}"
        " --threads {threads} --output {output:q} 2> {log:q}"
