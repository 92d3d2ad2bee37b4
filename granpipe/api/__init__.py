"""The Python API: what a user does with cases and results without the command line.

It is a room of its own above `pipeline`: it runs cases and opens what they left, draws with `export` and asks
`geometry` where the vessel ends. Nothing but the package's front door (``granpipe/__init__.py``) imports it.

Two classes hold a field, at two scales. `granpipe.field.Field` is what is stored and computed with: solids flux on the
faces of cells, at the scale of the simulation. `granpipe.api.flow.Flow` is what a user reads: bulk velocity in m/s at
any point, at the flow rate of the process. `Flow.stored` leads from the one to the other.
"""
