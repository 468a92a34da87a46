"""Commands of `twin` for a vehicle at sea, an entry point each."""
