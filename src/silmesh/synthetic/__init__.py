"""Made-up objects with their true meshes, photographed on a made-up turntable in ALOI's layout.

``layout``      names of the objects and of their photographs; imports nothing heavy
``solids``      signed distance functions and how they combine
``paints``      colours by position: bands, speckle, printed labels
``objects``     one module an object: its distance function and its paint
``make``        from a distance function to a watertight, coloured mesh
``turntable``   the cameras of the photographs
``photograph``  from a mesh and cameras to photographs and masks, by casting rays
"""
