# requires  an object's true mesh
# makes     its triangles, checked before any fit that is compared with them
# runs      silmesh.steps.truth


rule truth:
    input:
        lambda w: made([plan.of_object(w.object).truth]),
    output:
        "results/{object}/stages/truth.ply",
    log:
        "logs/truth/{object}.log",
    priority: 10
    resources:
        **resources("truth"),
    params:
        mesh=lambda w, input: where(plan.of_object(w.object).truth, input),
        read=lambda w: given_digest([plan.of_object(w.object).truth]),
        code=code_digest("silmesh.steps.truth"),
    message:
        "{wildcards.object}: reading its true mesh"
    shell:
        "python -m silmesh.steps truth --mesh {params.mesh:q} --output {output:q} 2> {log:q}"
