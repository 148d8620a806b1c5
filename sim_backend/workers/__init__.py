"""Work that is spread over this process, processes of this machine, or a cluster: one seam, ``pool.map``."""
