export const useMediaQuery = () => false;
export const useDisclosure = () => [false, { open() {}, close() {}, toggle() {} }] as const;
