"""The settings of each stage: the models that its function takes and the configuration is made of.

A setting is described, bounded and given its default here, once. The configuration is checked
against these models, a rule hands its step one of them as JSON, and the step gives it to its
function. Nothing heavy is imported here.
"""
