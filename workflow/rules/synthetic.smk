# requires  nothing
# makes     photographs and masks of a made-up object on a turntable, and its true mesh
# runs      silmesh.steps.synthetic
