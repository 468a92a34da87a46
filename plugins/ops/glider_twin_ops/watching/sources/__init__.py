"""Sources: from where a deployment's files come, a kind for each sort of them (a seam).

found = arrived(WatchedDeployment.read("calypso"))
found.digest
"""
