"""Many specimens, each by itself: in batches, on this machine or a cluster, over a store."""
