# requires  nothing
# makes     photographs and masks of a made-up object on a turntable, and its true mesh
# runs      silmesh.steps.synthetic


rule synthetic:
    output:
        images=[
            f"resources/synthetic/png2/{{name}}/{file}"
            for file in photograph_names("{name}")
        ],
        masks=[
            f"resources/synthetic/mask2/{{name}}/{file}"
            for file in photograph_names("{name}")
        ],
        truth="resources/synthetic/truth/{name}.ply",
    log:
        "logs/synthetic/{name}.log",
    priority: 20
    resources:
        **resources("synthetic"),
    params:
        images=lambda w, output: Path(output.images[0]).parent,
        masks=lambda w, output: Path(output.masks[0]).parent,
        code=code_digest("silmesh.steps.synthetic"),
    message:
        "{wildcards.name}: making the object and its photographs"
    shell:
        "python -m silmesh.steps synthetic {wildcards.name} --images {params.images:q}"
        " --masks {params.masks:q} --truth {output.truth:q} 2> {log:q}"
