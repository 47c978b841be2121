"""Former name of what it imports; goes once no file uses it."""

from thirdbody.export.vtk import export_pvd as export_pvd
