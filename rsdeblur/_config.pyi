VERSION: str
COMPILER: str
CEXT_ABSENT: str  # why the C extension was not built; empty if it was
