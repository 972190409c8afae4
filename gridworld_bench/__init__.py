"""The paper's grid worlds: action and critique queries on finite MDPs."""
