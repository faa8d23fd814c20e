"""The agent of one robot: takes skill requests, drives its machine, reports what became of them."""
