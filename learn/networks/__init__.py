"""Networks: from what a vehicle measures to its velocity through the water."""
