from silmesh.api import colour as colour
from silmesh.api import evaluate as evaluate
from silmesh.api import find_cameras as find_cameras
from silmesh.api import find_silhouettes as find_silhouettes
from silmesh.api import fit as fit
from silmesh.api import initial_mesh as initial_mesh
from silmesh.api import read_photographs as read_photographs
from silmesh.api import reconstruct as reconstruct
