# requires  nothing but a web server or an object store that has it
# makes     the photographs, the masks or the true mesh of an object from afar; the archive that they
#           are in stays in the user's cache; not again when the code of it changes
# runs      silmesh.steps.fetch


rule fetch:
    output:
        directory("resources/remote/{remote}"),
    log:
        "logs/fetch/{remote}.log",
    priority: 20
    localrule: True
    params:
        source=lambda w: plan.address(w.remote).text,
    message:
        "fetching {wildcards.remote}, unless the cache has its archive"
    shell:
        "python -m silmesh.steps fetch --source {params.source:q} --output {output:q} 2> {log:q}"
