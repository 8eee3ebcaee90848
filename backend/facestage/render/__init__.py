"""Ray tracing: the only place that imports Mitsuba and Dr.Jit.

May import the contract and ``facestage.system.native``. Hands out and takes numpy arrays only.
"""

from facestage.system.native import prepare_renderer

# Before any module of this folder imports them: Dr.Jit reads where libLLVM is when it is first
# imported.
prepare_renderer()
