# requires  photographs with masks of the objects that a network is trained on
# makes     weights of DeepLabv3, and the loss and the IoU of each epoch
# runs      silmesh.steps.train


# The checkpoint is no output, which Snakemake would remove when a run is killed.
if plan.config.train:

    rule train:
        input:
            made(training_files()),
        output:
            weights=str(TRAINED),
            table=str(TRAINED.with_name("epochs.csv")),
        log:
            "logs/train.log",
        threads: all_cores("train")
        resources:
            **resources("train"),
        params:
            table=str(plan.config.datasets),
            files=texts(training_files()),
            read=given_digest(training_files()),
            settings=settings(plan.config.train),
            checkpoint=str(TRAINED.with_name("checkpoint.pt")),
            code=code_digest("silmesh.steps.train"),
        message:
            "training DeepLabv3 on photographs with masks"
        shell:
            "python -m silmesh.steps train --datasets {params.table:q} --settings {params.settings:q}"
            " --threads {threads} --checkpoint {params.checkpoint:q}"
            " --table {output.table:q} --output {output.weights:q} 2> {log:q}"
