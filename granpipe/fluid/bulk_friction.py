class BulkFrictionLaw: pass
