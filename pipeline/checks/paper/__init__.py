"""The paper against us: Table 2, contacts, readings and assumptions, figures, and the procedure that it replaces.

Source: Pham, Tran, Ahn, Int. J. Precis. Eng. Manuf. 18 (2017), DOI 10.1007/s12541-017-0045-0 ("the paper").
"""
